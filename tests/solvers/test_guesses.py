import dataclasses

import numpy as np
import pytest

from ocp_envs.goal import FREE, Goal
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.guesses import bends_of, guesses
from ocp_envs.system import Box, Coordinate, System
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.solvers.programs import DISC


@pytest.mark.parametrize("kind", ["line", "rollout", "drift"])
def test_guesses_are_bounded_and_start_right(kind):
    rng = np.random.default_rng(1)
    p = np.array([[0.1, 1.9], [6.2, -2.0]])
    plans = guesses(PENDULUM, p, np.array([0, 2]), rng, kind)
    np.testing.assert_array_equal(plans.states[:, 0], p)
    assert PENDULUM.system.state.contains(plans.states).all()
    assert PENDULUM.system.control.contains(plans.controls).all()
    if kind != "rollout":
        np.testing.assert_allclose(plans.states[:, -1], PENDULUM.targets[[0, 2]], atol=1e-12)


def test_bent_guesses_pass_an_obstacle_on_every_side():
    p, winding = np.tile([[-3.0, 0.3, 1.0]], (60, 1)), np.zeros(60, int)
    bent = guesses(DISC, p, winding, np.random.default_rng(0), "bend")
    straight = guesses(DISC, p, winding, np.random.default_rng(0), "line")
    np.testing.assert_allclose(bent.states[:, 0], straight.states[:, 0])
    np.testing.assert_allclose(bent.states[:, -1], straight.states[:, -1])
    box = DISC.system.state
    assert ((bent.states >= box.lower) & (bent.states <= box.upper)).all()
    middle = (bent.states - straight.states)[:, DISC.knots // 2]
    assert (middle > 0.1).any(axis=0).all()
    assert (middle < -0.1).any(axis=0).all()


def test_bends_of_a_solution_keep_its_ends_controls_and_duration():
    p, winding = np.tile([[-3.0, 0.3, 1.0]], (200, 1)), np.zeros(200, int)
    lines = guesses(DISC, p, winding, np.random.default_rng(0), "line")
    found = guesses(DISC, p, winding, np.random.default_rng(1), "drift")
    solved = np.arange(200) < 100
    bent = bends_of(DISC, lines, solved, found, np.random.default_rng(2))
    for name in ("controls", "duration"):
        np.testing.assert_array_equal(getattr(bent, name)[solved], getattr(found, name)[solved])
        np.testing.assert_array_equal(getattr(bent, name)[~solved], getattr(lines, name)[~solved])
    base = np.where(solved[:, None, None], found.states, lines.states)
    np.testing.assert_array_equal(bent.states[:, [0, -1]], base[:, [0, -1]])
    height = (bent.states - base)[:, DISC.knots // 2, 0]
    assert height[solved].std() < 0.7 * height[~solved].std()
    assert DISC.system.state.contains(bent.states).all()


def test_coordinates_that_end_free_follow_the_motion_in_lines_and_bends():
    """A clock is right at every knot, and the other coordinates are those of the line to the goal."""
    system = System(
        name="mass with a clock",
        state=Box((*DOUBLE_INTEGRATOR.system.state.coordinates, Coordinate("t", 0.0, 20.0, "s"))),
        control=DOUBLE_INTEGRATOR.system.control,
        constants={"mass": 1.0},
        dynamics=lambda x, u, c: [x[1], u[0] / c.mass, 1],
    )
    clocked = dataclasses.replace(
        DOUBLE_INTEGRATOR, system=system, goal=Goal([0, 0, FREE]), hold=0.0, rest=[0, 0, 0], id="Clocked-v0"
    )
    p, winding = np.array([[2.0, 0.5], [-3.0, 0.0]]), np.zeros(2, int)
    line = guesses(clocked, p, winding, np.random.default_rng(0), "line")
    bent = guesses(clocked, p, winding, np.random.default_rng(0), "bend")
    for plans in (line, bent):
        times = np.linspace(0.0, 1.0, clocked.knots) * plans.duration[:, None]
        np.testing.assert_allclose(plans.states[:, :, 2], times, atol=1e-12)
        np.testing.assert_allclose(plans.states[:, -1, :2], 0.0, atol=1e-12)
