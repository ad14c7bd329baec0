"""The actions given to an environment: numbers of one shape; a NaN is reported and acts nowhere."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from ocp_envs.envs.env import Env
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER


@pytest.mark.parametrize("action", [[np.nan], np.array([np.nan], np.float32)])
def test_a_nan_as_action_is_refused(action):
    env = Env(PENDULUM)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="PendulumSwingup-v0: expected a finite action, got"):
        env.step(action)
    env.step(np.zeros(1))  # the episode goes on


@pytest.mark.parametrize("action", [[None], ["0"], None, [[0.0], [1.0, 2.0]], [0j], 0.0, [0.0, 0.0], [[0.0]], []])
@pytest.mark.parametrize("kind", ["single", "vector"])
def test_actions_that_are_no_numbers_or_of_another_shape_are_refused(action, kind):
    env = Env(PENDULUM) if kind == "single" else VectorEnv(PENDULUM, 3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="PendulumSwingup-v0: expected"):
        env.step(action)


def test_infinite_actions_are_clipped_to_the_bounds():
    after = []
    for push in (np.inf, 1e300, 1.0):
        env = Env(PENDULUM)
        env.reset(options={"parameters": [1.0, 0.0]})
        after.append(env.step([push])[0])
    np.testing.assert_array_equal(after[0], after[2])
    np.testing.assert_array_equal(after[1], after[2])


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_rows_with_a_nan_are_marked_and_held_as_the_goal_is_while_the_others_go_on(mode):
    actions = np.tile(QUADCOPTER.goal.control, (3, 1)) * 1.1
    held = np.where([[False], [True], [False]], QUADCOPTER.goal.control, actions)
    outcomes = []
    broken_sensor = actions.copy()
    broken_sensor[1, 2] = np.nan
    for given in (broken_sensor, held):
        envs = VectorEnv(QUADCOPTER, 3, mode)
        envs.reset(seed=1)
        outcomes.append((envs.step(given), envs.state))
    (broken, state), (healthy, expected) = outcomes
    np.testing.assert_array_equal(state, expected)
    np.testing.assert_array_equal(broken[1], healthy[1])
    np.testing.assert_array_equal(broken[4]["invalid_action"], [False, True, False])
    np.testing.assert_array_equal(broken[4]["_invalid_action"], [False, True, False])
    assert "invalid_action" not in healthy[4]


def test_a_nan_for_a_row_that_is_being_reset_is_ignored():
    envs = VectorEnv(PENDULUM, 2, time_limit=0.02)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 1)))
    assert "invalid_action" not in envs.step(np.full((2, 1), np.nan))[4]
