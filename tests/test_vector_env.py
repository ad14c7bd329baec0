"""The vector environment against single environments, row by row, and Gymnasium's own SyncVectorEnv."""

from __future__ import annotations

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import ocp_envs
from ocp_envs.env import Env, VectorEnv
from ocp_envs.problem import OutsideBoxError
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE

ROWS = 5
ALL_PROBLEMS = [*(ocp_envs.load(name) for name in ocp_envs.names()), QUADCOPTER_OBSTACLE]
IMPERFECT = {"constants": {"mass": 1.1}, "disturbance": 0.2, "observation_noise": 0.05, "delay": 2}


def assert_equal_info(ours, theirs):
    assert set(ours) == set(theirs)
    for key, expected in theirs.items():
        if isinstance(expected, dict):
            assert_equal_info(ours[key], expected)
        elif key == "final_obs":
            assert [None if v is None else v.tolist() for v in ours[key]] == [
                None if v is None else v.tolist() for v in expected
            ]
        else:
            assert ours[key].dtype == expected.dtype, key
            np.testing.assert_array_equal(ours[key], expected, err_msg=key)


def assert_equal_step(ours, theirs):
    for mine, expected in zip(ours[:4], theirs[:4]):
        assert mine.dtype == expected.dtype
        np.testing.assert_array_equal(mine, expected)
    assert_equal_info(ours[4], theirs[4])


def restart_ended(envs, terminated, truncated):
    if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and (terminated | truncated).any():
        return envs.reset(options={"reset_mask": terminated | truncated})
    return None


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("imperfections", [{}, IMPERFECT], ids=["perfect", "imperfect"])
@pytest.mark.parametrize("problem", ALL_PROBLEMS, ids=lambda p: p.id)
def test_equals_gymnasiums_sync_vector_env(problem, mode, imperfections):
    # Half a second of time limit and coarse ticks: rows end by time, and large actions make some leave the box.
    arguments = {"dt": 0.1, "time_limit": 1.5, **imperfections}
    if problem is QUADCOPTER_OBSTACLE and imperfections:
        arguments["constants"] = {"mass": 0.55}
    sync = SyncVectorEnv([lambda: Env(problem, **arguments)] * ROWS, autoreset_mode=mode)
    ours = VectorEnv(problem, ROWS, mode, **arguments)
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.observation_space == sync.observation_space
    assert ours.action_space == sync.action_space
    first, info = ours.reset(seed=7)
    expected, expected_info = sync.reset(seed=7)
    np.testing.assert_array_equal(first, expected)
    assert_equal_info(info, expected_info)
    generator = np.random.default_rng(1)
    ends = 0
    for tick in range(60):
        if tick == 20:  # desynchronise the rows
            mask = np.array([True, False, True, False, False])
            pair = [envs.reset(seed=3, options={"reset_mask": mask.copy()}) for envs in (ours, sync)]
            np.testing.assert_array_equal(pair[0][0], pair[1][0])
            assert_equal_info(pair[0][1], pair[1][1])
        box = problem.system.control
        actions = generator.uniform(box.lower, box.upper, (ROWS, problem.system.nu)).astype(np.float32)
        step, expected = ours.step(actions), sync.step(actions)
        assert_equal_step(step, expected)
        np.testing.assert_array_equal(ours.state, np.array(sync.get_attr("state")))
        np.testing.assert_array_equal(ours.parameters, np.array(sync.get_attr("parameters")))
        ends += int((step[2] | step[3]).sum())
        pair = [restart_ended(envs, step[2].copy(), step[3].copy()) for envs in (ours, sync)]
        if pair[0] is not None:
            np.testing.assert_array_equal(pair[0][0], pair[1][0])
            assert_equal_info(pair[0][1], pair[1][1])
    assert ends > ROWS
