"""Parameters near the goal, against the definition of the shrunk box."""

import dataclasses

import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets.discontinuity import off_centre
from ocp_envs.sets.near import initial_values, near_goal, sample_near
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.system import Box
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

#: Few solves, of large problems.
pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]


def turned(lower, upper):
    """The pendulum with angles from ``lower`` to ``upper``."""
    theta, omega = PENDULUM.parameters.coordinates
    return dataclasses.replace(
        PENDULUM, parameters=Box((dataclasses.replace(theta, lower=lower, upper=upper), omega)), symmetry=None
    )


def with_goal(x):
    """The double integrator with its goal at ``x``, in the box from -5 to 5."""
    goal = dataclasses.replace(DOUBLE_INTEGRATOR.goal, state=np.array([x, 0.0]))
    return dataclasses.replace(DOUBLE_INTEGRATOR, goal=goal)


def test_every_initial_value_shrinks_and_no_context_does():
    box = near_goal(QUADCOPTER_OBSTACLE, 0.3)
    assert initial_values(QUADCOPTER_OBSTACLE) == ("x", "y", "z")
    np.testing.assert_allclose(box.lower, [-3, -3, -3, -10, -10, -10, 1])
    np.testing.assert_allclose(box.upper, [3, 3, 3, 10, 10, 10, 5])
    np.testing.assert_allclose(near_goal(WALLED_INTEGRATOR, 0.1).upper, [0.5, 10.0])


def test_only_the_coordinates_that_are_named_shrink():
    box = near_goal(VEHICLE, 0.15, ("x", "y"))
    np.testing.assert_allclose(box.upper, [1.5, 1.5, np.pi, 3.1])
    np.testing.assert_array_equal(box.lower, -box.upper)


@pytest.mark.parametrize(
    ("goal", "interval"),
    [(0.0, (-0.5, 0.5)), (5.0, (4.0, 5.0)), (-4.0, (-4.1, -3.1)), (9.0, (4.0, 5.0))],
    ids=["centre", "end", "inside", "outside"],
)
def test_the_box_shrinks_towards_the_goal_and_stays_inside(goal, interval):
    box = near_goal(with_goal(goal), 0.1, ("x",))
    np.testing.assert_allclose([box.lower[0], box.upper[0]], interval)


@pytest.mark.parametrize("lower", [0.0, -np.pi, 3 * np.pi, 1.0], ids=["0", "-pi", "3 pi", "1"])
def test_a_whole_turn_is_near_the_goal_on_both_sides_wherever_it_begins(lower):
    problem = turned(lower, lower + 2 * np.pi)
    p = sample_near(problem, 3, 400, 0.15)
    assert problem.parameters.contains(p).all()
    theta = problem.system.difference(problem.start(p)[0], problem.goal.state)[:, 0]
    assert np.quantile(theta, [0.0, 0.5, 1.0]) == pytest.approx([-0.15 * np.pi, 0, 0.15 * np.pi], abs=0.05)


def test_part_of_a_turn_shrinks_towards_the_turn_of_the_goal_that_is_nearest():
    box = near_goal(turned(-3 * np.pi / 2, 0.0), 0.1)  # the goal, π, is also at −π
    assert box.lower[0] < -np.pi < box.upper[0]
    assert box.width[0] == pytest.approx(0.15 * np.pi)


@pytest.mark.parametrize("problem", [PENDULUM, VEHICLE, QUADCOPTER], ids=lambda problem: problem.id)
def test_draws_are_uniform_in_the_box_without_the_goal_ball(problem):
    p, box = sample_near(problem, 7, 3_000, 0.15), near_goal(problem, 0.15)
    assert box.contains(p).all()
    np.testing.assert_allclose((p.mean(axis=0) - box.centre) / box.width, 0, atol=5 * 0.29 / np.sqrt(len(p)))
    assert (problem.goal_error(problem.start(p)[0]) >= problem.goal.radius).all()


def test_a_smaller_draw_begins_a_larger_one():
    np.testing.assert_array_equal(sample_near(PENDULUM, 3, 2_500, 0.1)[:40], sample_near(PENDULUM, 3, 40, 0.1))
    assert not np.allclose(sample_near(PENDULUM, 4, 40, 0.1), sample_near(PENDULUM, 3, 40, 0.1))
    assert sample_near(PENDULUM, 4, 0, 0.1).shape == (0, 2)


@pytest.mark.parametrize("fraction", [0.0, -0.1, 1.5, np.nan])
def test_a_fraction_that_is_none_is_refused(fraction):
    with pytest.raises(ValueError, match="0 < fraction ≤ 1"):
        near_goal(PENDULUM, fraction)


@pytest.mark.parametrize("names", [("wall",), ("x", "y"), ()])
def test_coordinates_that_are_no_initial_values_are_refused(names):
    with pytest.raises(ValueError, match=r"expected coordinates from \['x'\]"):
        near_goal(WALLED_INTEGRATOR, 0.1, names)


def test_a_box_in_the_goal_ball_is_refused():
    with pytest.raises(ValueError, match="all begin in the goal ball"):
        sample_near(PENDULUM, 0, 3, 0.01)


def test_an_obstacle_blocks_the_free_optimum_near_the_goal():
    p = sample_near(QUADCOPTER_OBSTACLE, 5, 3, 0.3)
    assert near_goal(QUADCOPTER_OBSTACLE, 0.3).contains(p).all()
    with GuardedSolver(QUADCOPTER) as solver:
        assert (off_centre(QUADCOPTER_OBSTACLE, p, solver) < 1).all()
    start, centre, radius = p[:, :3], p[:, 3:6], p[:, 6]
    assert (np.linalg.norm(centre, axis=1) > radius).all()
    assert (np.linalg.norm(centre - start, axis=1) > radius).all()
