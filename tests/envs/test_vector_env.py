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
from ocp_envs.envs.env import Env
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER

ROWS = 5
ALL_PROBLEMS = [ocp_envs.load(name) for name in ocp_envs.names()]
IMPERFECT = {"disturbance": 0.2, "observation_noise": 0.05, "delay": 2}


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
    # Long control steps and a short time limit: rows end by time, and quadcopters tumble out of the box.
    arguments = {"dt": 0.1, "time_limit": 1.5, **imperfections}
    if imperfections:
        constants = problem.system.constants
        name, nominal = next((name, value) for name, value in constants.items() if name not in problem.context.names)
        arguments["constants"] = {name: 1.1 * nominal}
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
    for k in range(60):
        if k == 20:  # desynchronise the rows
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


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_equals_sync_vector_env_at_the_goal_and_outside_the_box(mode):
    arguments = {"dt": 0.1, "constants": {"torque_gain": 12.0}}
    starts = np.array([[np.pi - 0.3, 0.4], [0.0, 0.0], [np.pi, 0.0], [1.0, 1.0], [6.0, -2.0]])
    sync = SyncVectorEnv([lambda: Env(PENDULUM, **arguments)] * ROWS, autoreset_mode=mode)
    ours = VectorEnv(PENDULUM, ROWS, mode, **arguments)
    for envs in (sync, ours):
        envs.reset(seed=0)
    ours.reset(options={"parameters": starts})
    for env, start in zip(sync.envs, starts):
        env.reset(options={"parameters": start})
    reached = failed = 0
    for _ in range(40):
        # A saturated push: some rows pass the goal, others are spun out of the box.
        actions = np.clip(np.sin(ours.state[:, :1]) * 0.5 - 0.1, -1, 1).astype(np.float32)
        actions[1] = 1.0
        step, expected = ours.step(actions), sync.step(actions)
        assert_equal_step(step, expected)
        info = step[4].get("final_info", step[4])
        reached += int((info.get("is_success", np.zeros(ROWS, bool))).sum())
        failed += int((info.get("failure", np.full(ROWS, "")) == "left_box").sum())
        for envs in (ours, sync):
            restart_ended(envs, step[2].copy(), step[3].copy())
    assert reached > 0
    assert failed > 0


def test_disabled_rows_stand_still_until_they_are_reset():
    envs = VectorEnv(PENDULUM, 2, AutoresetMode.DISABLED)
    envs.reset(options={"parameters": [[np.pi, 0.0], [0.0, 0.0]]})
    _, _, terminated, _, info = envs.step(np.zeros((2, 1)))
    assert terminated.tolist() == [True, False]
    before = envs.state
    for _ in range(3):
        _, reward, terminated, _, info = envs.step(np.ones((2, 1)))
        assert terminated.tolist() == [True, False]
        assert reward[0] == 0.0
        assert reward[1] < 0
        assert info["_cost"].tolist() == [False, True]
    assert np.array_equal(envs.state[0], before[0])
    assert not np.array_equal(envs.state[1], before[1])
    moving = envs.state[1]
    envs.reset(options={"parameters": [1.0, 0.0], "reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(envs.state, [[1.0, 0.0], moving])
    assert not envs.step(np.zeros((2, 1)))[2].any()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_made_by_name(mode):
    envs = gym.make_vec(
        "PendulumSwingup-v0", num_envs=4, vectorization_mode="vector_entry_point", autoreset_mode=mode, dt=0.05
    )
    assert isinstance(envs.unwrapped, VectorEnv)
    assert envs.dt == 0.05
    assert envs.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert envs.metadata["render_fps"] == 20
    observation, info = envs.reset(seed=0)
    assert observation in envs.observation_space
    np.testing.assert_array_equal(info["parameters"], envs.parameters)


def test_gymnasiums_wrappers_take_it():
    envs = gym.make_vec("PendulumSwingup-v0", num_envs=3, time_limit=0.1)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs.reset(seed=0)
    episodes = 0
    for _ in range(20):
        info = envs.step(np.ones((3, 1), np.float32))[4]
        if "episode" in info:
            episodes += int(info["_episode"].sum())
            np.testing.assert_array_equal(info["episode"]["l"][info["_episode"]], 5)
            np.testing.assert_allclose(info["episode"]["r"][info["_episode"]], -0.2, rtol=1e-5)
    assert episodes == 9


@pytest.mark.parametrize("problem", ALL_PROBLEMS, ids=lambda p: p.id)
def test_survives_any_action(problem):
    envs = VectorEnv(problem, 64, AutoresetMode.SAME_STEP)
    envs.reset(seed=0)
    generator = np.random.default_rng(0)
    for _ in range(150):
        actions = generator.choice([np.nan, np.inf, -np.inf, 1e30, 0.0], size=(64, problem.system.nu))
        observation, reward, _, _, _ = envs.step(actions)
        assert observation in envs.observation_space
        assert np.isfinite(reward).all()
        assert problem.system.state.contains(envs.state).all()


def test_seeds_may_be_given_row_by_row_and_unseeded_rows_differ():
    envs = VectorEnv(PENDULUM, 3)
    np.testing.assert_array_equal(envs.reset(seed=[4, 5, 6])[0], envs.reset(seed=4)[0])
    assert len(np.unique(envs.reset()[0], axis=0)) == 3
    assert len(np.unique(VectorEnv(PENDULUM, 3).reset()[0], axis=0)) == 3
    with pytest.raises(ValueError, match="3 seeds"):
        envs.reset(seed=[1, 2])


def test_refuses_bad_calls():
    envs = VectorEnv(QUADCOPTER, 3)
    with pytest.raises(ResetNeeded, match="reset"):
        envs.step(np.zeros((3, 4)))
    envs.reset(seed=0)
    for shape in ((3, 1), (4,), (2, 4)):
        with pytest.raises(ValueError, match=r"expected an action of shape \(3, 4\)"):
            envs.step(np.zeros(shape))
    with pytest.raises(ValueError, match=r"num_envs: expected a whole number in 1"):
        VectorEnv(QUADCOPTER, 0)
    with pytest.raises(ValueError, match="autoreset_mode: expected one of"):
        VectorEnv(QUADCOPTER, 2, "sometimes")


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))], ids=["copy", "pickle"])
def test_a_copy_goes_on_alike_and_apart(duplicate):
    envs = gym.make_vec("PendulumSwingup-v0", num_envs=3, observation_noise=0.1, time_limit=0.2)
    envs.reset(seed=3)
    other = duplicate(envs)
    for _ in range(30):
        assert_equal_step(envs.step(np.ones((3, 1))), other.step(np.ones((3, 1))))
    envs.step(np.ones((3, 1)))
    assert not np.array_equal(envs.state, other.state)


def test_what_is_given_out_does_not_change_later():
    envs = VectorEnv(PENDULUM, 2)
    first, _ = envs.reset(seed=0)
    state, kept = envs.state, first.copy()
    step = envs.step(np.ones((2, 1)))
    copies = [v.copy() for v in step[:4]]
    envs.step(np.ones((2, 1)))
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(state.astype(np.float32), kept)
    for given, expected in zip(step[:4], copies):
        np.testing.assert_array_equal(given, expected)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_own_vectorisation_works_too(mode):
    envs = gym.make_vec("PendulumSwingup-v0", num_envs=2, vectorization_mode=mode)
    try:
        first, _ = envs.reset(seed=0)
        np.testing.assert_array_equal(first, VectorEnv(PENDULUM, 2).reset(seed=0)[0])
        assert envs.step(np.ones((2, 1), np.float32))[1] == pytest.approx([-0.04, -0.04])
    finally:
        envs.close()
