"""Actions round the goal."""

import dataclasses

import numpy as np
import pytest

from moe_policy.rl.actions import Actions
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.problems.vehicle import VEHICLE


def test_no_action_holds_the_goal_and_the_directions_are_roll_pitch_yaw_and_thrust():
    actions = Actions.round_goal(QUADCOPTER, 0.75, 0.04)
    np.testing.assert_allclose(actions.controls(np.zeros(4)), QUADCOPTER.goal.control)
    patterns = np.sign(np.round(actions.directions, 9)).T
    expected = [[0, 1, 0, -1], [-1, 0, 1, 0], [1, -1, 1, -1], [1, 1, 1, 1]]
    np.testing.assert_array_equal(np.abs(patterns @ np.transpose(expected)), np.diag([2, 2, 4, 4]))


def test_a_full_action_changes_no_coordinate_by_more_than_its_stride_and_no_control_beyond_its_bounds():
    for stride in (0.75, (0.75, 0.5, 0.075, 1.0)):
        actions = Actions.round_goal(QUADCOPTER, stride, 0.04)
        goal, control = QUADCOPTER.terminal.central_state[None], QUADCOPTER.terminal.central_control[None]
        _, effect = QUADCOPTER.functions.linearisation(1)(goal, control, np.zeros((1, 0)), np.full((1, 1), 0.04))
        change = np.abs(effect[0] @ actions.directions) / QUADCOPTER.system.state.scale[:, None]
        assert (change.max(axis=0) <= np.asarray(stride) + 1e-9).all()
        assert QUADCOPTER.system.control.contains(control + actions.directions.T, 1e-9).all()


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER], ids=lambda p: p.id)
def test_controls_and_actions_are_inverses(problem):
    actions = Actions.round_goal(problem, 0.1, 0.04)
    chosen = np.random.default_rng(0).uniform(-0.2, 0.2, (7, problem.system.nu))
    np.testing.assert_allclose(actions.actions(actions.controls(chosen)), chosen, atol=1e-12)


def test_actions_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"expected a centre \(2,\) and directions \(2, 2\), got shapes \(3,\)"):
        Actions(VEHICLE, np.zeros(3))
    with pytest.raises(ValueError, match="must be independent"):
        Actions(VEHICLE, np.zeros(2), np.ones((2, 2)))
    at_bound = dataclasses.replace(QUADCOPTER.goal, control=np.zeros(4))
    with pytest.raises(ValueError, match="need a control there inside its box"):
        Actions.round_goal(dataclasses.replace(QUADCOPTER, goal=at_bound, hold=0.0), 1.0, 0.04)
