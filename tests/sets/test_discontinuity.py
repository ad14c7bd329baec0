"""Distances from the discontinuity: cost differences by hand, and spheres put where the free path runs."""

import dataclasses

import numpy as np
import pytest

import ocp_envs
from ocp_envs.distribution import Blocked
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets.discontinuity import EqualCosts, SphereCentre, discontinuity_of, off_centre, relative_cost_difference
from ocp_envs.sets.free_paths import solve_free
from ocp_envs.solvers.solver import GuardedSolver
from tests.small_problems import DOUBLE_INTEGRATOR

#: Few solves, of large problems.
pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
START = np.array([8.0, -6.0, 4.0])


def test_the_cost_difference_is_that_of_the_two_cheapest_families():
    costs = np.array([[4.0, 2.0, 3.0], [np.inf, 5.0, 5.0], [np.inf, 7.0, np.inf], [np.inf] * 3])
    np.testing.assert_allclose(relative_cost_difference(costs), [0.5, 0.0, np.inf, np.inf])
    np.testing.assert_allclose(relative_cost_difference(np.array([[-1.0, -2.0], [0.0, 1.0]])), [0.5, np.inf])
    np.testing.assert_array_equal(relative_cost_difference(np.ones((3, 1))), np.inf)
    distance = discontinuity_of(PENDULUM).distance(PENDULUM, np.zeros((4, 2)), costs)
    np.testing.assert_array_equal(distance, relative_cost_difference(costs))


def test_a_pendulum_and_its_mirror_image_have_the_same_cost_difference():
    """Reflected about upright: θ → 2π − θ, ω → −ω."""
    theta, omega = 2.2, 1.4
    here, there = (ocp_envs.solve(PENDULUM, p).modes.cost for p in ([theta, omega], [2 * np.pi - theta, -omega]))
    differences = relative_cost_difference(np.stack([here, there]))
    np.testing.assert_allclose(differences[0], differences[1], rtol=1e-4)
    np.testing.assert_allclose(differences[0], np.diff(np.sort(here))[0] / here.min(), rtol=1e-12)


def test_which_problems_have_a_discontinuity():
    problems = PENDULUM, VEHICLE, QUADCOPTER, QUADCOPTER_OBSTACLE, DOUBLE_INTEGRATOR
    found = [discontinuity_of(problem) for problem in problems]
    assert found == [EqualCosts(), EqualCosts(), None, SphereCentre(), None]
    no_sphere = dataclasses.replace(QUADCOPTER_OBSTACLE, distribution=Blocked(QUADCOPTER))
    assert discontinuity_of(no_sphere) == EqualCosts()
    with pytest.raises(ValueError, match="expected a problem with a sphere; its distribution names no radius"):
        off_centre(no_sphere, np.zeros((1, 7)))


@pytest.fixture(scope="module")
def solver():
    with GuardedSolver(QUADCOPTER) as made:
        yield made


@pytest.fixture(scope="module")
def middle(solver):
    """A knot in the middle of a free optimal path, and a direction normal to the path there."""
    states = solve_free(QUADCOPTER_OBSTACLE, START[None], solver).states[0, 10]
    normal = np.cross(states[3:6], [0.0, 0.0, 1.0])
    return states[:3], normal / np.linalg.norm(normal)


@pytest.mark.parametrize("solved", [True, False], ids=["solved", "interpolated"])
def test_spheres_on_the_free_path_and_beside_it(middle, solver, solved):
    place, normal = middle
    aside, radius = np.array([0.0, 0.2, 0.5, 0.9]), 2.0
    p = np.array([[*START, *(place + share * radius * normal), radius] for share in aside])
    if solved:
        found = off_centre(QUADCOPTER_OBSTACLE, p, solver)
    else:
        found = discontinuity_of(QUADCOPTER_OBSTACLE).distance(QUADCOPTER_OBSTACLE, p, np.ones((4, 8)))
    # The path is bent: the nearest point is no farther than the knot, and not much nearer.
    assert found[0] < (1e-3 if solved else 0.02)
    assert (found[1:] <= aside[1:] + 0.01).all()
    assert (found[1:] > 0.95 * aside[1:]).all()


def test_only_spheres_have_a_centre():
    with pytest.raises(ValueError, match="expected a problem with a free one"):
        off_centre(PENDULUM, np.zeros((1, 2)))
