"""Parameters whose angles are written in another turn."""

import dataclasses

import numpy as np
import pytest

from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.system import Box, Coordinate, wrap


@pytest.mark.parametrize("turn", [-1, 2])
def test_whole_turns_of_angles_lead_into_the_box(turn):
    p = np.array([[0.5, 1.0], [6.0, -2.0], [3.0, 2.0]])
    written = p + np.array([2 * np.pi * turn, 0.0])
    np.testing.assert_array_equal(PENDULUM.check_parameters(written), written)
    within, turns = PENDULUM.in_one_turn(written)
    np.testing.assert_allclose(within, p, atol=1e-14)
    np.testing.assert_allclose(turns, [[2 * np.pi * turn, 0.0]] * 3, atol=1e-14)
    with pytest.raises(OutsideBoxError, match="extrapolate=True"):
        PENDULUM.check_parameters([0.5 + 2 * np.pi * turn, 2.1])


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_angles_in_the_box_are_not_changed_by_a_bit(problem):
    p = problem.parameters.draw(np.random.default_rng(0), 500)
    within, turns = problem.in_one_turn(p)
    np.testing.assert_array_equal(within, p)
    assert not turns.any()


@pytest.mark.parametrize("turn", range(-3, 4))
def test_the_ends_of_a_box_that_covers_a_turn_are_one_state(turn):
    """Rounding does not decide by which end it is written."""
    for end in (0.0, 2 * np.pi, 1e-15, -1e-15, 2 * np.pi - 1e-15):
        within, turns = PENDULUM.in_one_turn([end + 2 * np.pi * turn, 0.0])
        assert abs(within[0, 0]) < 1e-13
        np.testing.assert_allclose(within[0, 0] + turns[0, 0], end + 2 * np.pi * turn, atol=1e-13)


def test_the_turn_of_a_wider_or_narrower_box_lies_around_its_centre():
    def boxed(lower, upper):
        box = Box((Coordinate("theta", lower, upper, "rad"), *PENDULUM.parameters.coordinates[1:]))
        return dataclasses.replace(PENDULUM, parameters=box)

    angles = np.linspace(-7, 7, 15)
    p = np.stack([angles, np.zeros(15)], axis=1)
    for problem in (boxed(-1.0, 1.0), boxed(-2 * np.pi, 2 * np.pi)):
        within, _ = problem.in_one_turn(p)
        np.testing.assert_allclose(within[:, 0], wrap(angles, 2 * np.pi), atol=1e-14)
    np.testing.assert_array_equal(boxed(-1.0, 1.0).check_parameters([2 * np.pi, 0.0]), [[2 * np.pi, 0.0]])
    with pytest.raises(OutsideBoxError):
        boxed(-1.0, 1.0).check_parameters([3.0, 0.0])


def test_coordinates_without_a_period_stay():
    p = QUADCOPTER.parameters.upper[None] * 100
    np.testing.assert_array_equal(QUADCOPTER.in_one_turn(p)[0], p)
