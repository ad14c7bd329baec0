"""The recursion of no plans, and of several plans at once."""

import numpy as np

from moe_policy.control.lqr import Regulator
from ocp_envs.problems.uncertain_pendulum import UNCERTAIN_PENDULUM
from tests.small_problems import DOUBLE_INTEGRATOR


def test_no_plans_have_no_gains():
    regulator = Regulator(DOUBLE_INTEGRATOR, 0.02)
    empty = regulator.along(np.zeros((0, 4, 2)), np.zeros((0, 3, 1)), np.zeros((0, 0)), np.zeros(0, np.int64))
    assert [part.shape for part in empty] == [(0, 4, 1, 2), (0, 4, 1, 1)]


def test_a_plan_has_the_same_gains_in_every_batch():
    """The weight at its end is that of its own context, whatever the order of the plans by length."""
    regulator, rng = Regulator(UNCERTAIN_PENDULUM, 0.02), np.random.default_rng(0)
    states, controls, steps = rng.normal(size=(3, 6, 2)), rng.uniform(-1, 1, (3, 5, 1)), np.array([2, 5, 3])
    contexts = np.array([[0.7, 1.3], [1.3, 0.7], [1.0, 1.0]])
    together, _ = regulator.along(states, controls, contexts, steps)
    for i in range(3):
        part = slice(i, i + 1)
        alone, _ = regulator.along(states[part], controls[part], contexts[part], steps[part])
        np.testing.assert_allclose(together[part], alone, rtol=1e-12)
