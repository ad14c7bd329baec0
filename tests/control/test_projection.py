"""Projections against bounded least squares."""

import numpy as np
from scipy.optimize import lsq_linear

from moe_policy.control.projection import project
from ocp_envs.problems.quadcopter import QUADCOPTER


def test_a_projection_solves_a_bounded_least_squares_problem():
    rng = np.random.default_rng(0)
    box, root = QUADCOPTER.system.control, rng.normal(size=(50, 4, 4))
    wanted = rng.uniform(box.lower - 3, box.upper + 3, (50, 4))
    found = project(wanted, root.swapaxes(1, 2) @ root, box)
    for i in range(50):
        exact = lsq_linear(root[i], root[i] @ wanted[i], (box.lower, box.upper), tol=1e-14)
        excess = np.sum((root[i] @ (found[i] - wanted[i])) ** 2) / 2 - exact.cost
        assert excess < 1e-6 * (1 + exact.cost)
    clipped = np.clip(wanted, box.lower, box.upper)
    assert not np.allclose(found, clipped)
    np.testing.assert_array_equal(project(wanted, np.tile(np.diag([1.0, 2, 3, 4]), (50, 1, 1)), box), clipped)
