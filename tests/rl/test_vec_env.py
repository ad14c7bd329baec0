"""The adapter to Stable-Baselines3."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from moe_policy.rl.vec_env import SB3VecEnv
from moe_policy.rl.wrappers import VectorFeatureObservation
from tests.learners import ENV_ID, wrapped, wrapped_vector


def swing(observations):
    """Pump energy into the pendulum: most episodes pass the goal ball's neighbourhood, some reach it."""
    sine, cosine, rate = observations.T
    energy = 2 * rate**2 - cosine - 1
    return np.clip(np.where(cosine < -0.95, -3 * rate + 2 * sine, -2 * energy * np.sign(rate)), -1, 1)[:, None]


def test_the_adapter_agrees_with_dummy_vec_env_row_by_row():
    arguments = {"dt": 0.1, "time_limit": 6.0}
    ours = VecMonitor(SB3VecEnv(wrapped_vector(6, **arguments)))
    theirs = VecMonitor(DummyVecEnv([lambda: wrapped(**arguments)] * 6))
    for env in (ours, theirs):
        env.seed(11)
    a, b = ours.reset(), theirs.reset()
    kinds = set()
    for _ in range(300):
        np.testing.assert_array_equal(a, b)
        actions = swing(a)
        a, our_rewards, our_dones, our_infos = ours.step(actions)
        b, their_rewards, their_dones, their_infos = theirs.step(actions)
        np.testing.assert_array_equal(our_rewards, their_rewards)
        np.testing.assert_array_equal(our_dones, their_dones)
        for mine, other in zip(our_infos, their_infos):
            assert mine.keys() == other.keys()
            assert mine["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert mine["is_success"] == other["is_success"]
            assert mine["cost"] == other["cost"]
            if "terminal_observation" in mine:
                np.testing.assert_array_equal(mine["terminal_observation"], other["terminal_observation"])
                assert (mine["episode"]["r"], mine["episode"]["l"]) == (other["episode"]["r"], other["episode"]["l"])
                kinds.add(mine["TimeLimit.truncated"])
    assert kinds == {True, False}, "the test must see episodes that end and episodes that are cut off"
    for mine, other in zip(ours.venv.reset_infos, theirs.venv.reset_infos):
        np.testing.assert_array_equal(mine["parameters"], other["parameters"])


def test_leaving_the_box_is_an_end_with_its_cause():
    env = SB3VecEnv(wrapped_vector(2, dt=0.1, time_limit=1000.0, terminate_at_goal=False))
    env.seed(0)
    env.reset()
    dones, infos = np.zeros(2, bool), [{}]
    for _ in range(3000):
        rate = np.stack(env.get_attr("state"))[:, 1:]
        _, _, dones, infos = env.step(np.where(rate >= 0, 1.0, -1.0))
        if dones.any():
            break
    row = int(np.flatnonzero(dones)[0])
    assert infos[row]["failure"] == "left_box"
    assert not infos[row]["TimeLimit.truncated"]


def test_seeds_and_options_are_used_once():
    env = SB3VecEnv(wrapped_vector(3))
    p = np.array([[0.5, 0.0], [1.0, 1.0], [2.0, -1.0]])
    env.set_options([{"parameters": row} for row in p])
    env.reset()
    np.testing.assert_array_equal(np.stack(env.get_attr("parameters")), p)
    env.seed(3)
    first = env.reset()
    assert not np.array_equal(env.reset(), first)
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), first)


def test_attributes_are_read_by_row_and_set_for_all():
    env = SB3VecEnv(wrapped_vector(3, dt=0.05))
    env.reset()
    assert env.get_attr("dt", indices=[0, 2]) == [0.05, 0.05]
    assert [state.shape for state in env.get_attr("state", indices=1)] == [(2,)]
    assert env.has_attr("problem")
    assert not env.has_attr("no_such_thing")
    assert env.env_is_wrapped(VectorFeatureObservation) == [True] * 3
    assert env.env_is_wrapped(gym.wrappers.vector.ClipReward, indices=[0]) == [False]
    env.set_attr("note", "x")
    assert env.get_attr("note") == ["x"] * 3
    with pytest.raises(ValueError, match="one batched environment"):
        env.set_attr("note", "y", indices=[0])
    assert env.env_method("close_extras") == [None] * 3
    env.close()


def test_an_environment_that_restarts_by_itself_is_refused():
    with pytest.raises(ValueError, match='autoreset_mode="Disabled"'):
        SB3VecEnv(gym.make_vec(ENV_ID, num_envs=2))
