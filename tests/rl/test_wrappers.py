"""Wrappers of single and of vector environments."""

import contextlib

import gymnasium as gym
import numpy as np
import pytest

from moe_policy.rl.features import Features
from moe_policy.rl.wrappers import (
    FeatureObservation,
    NormalisedAction,
    RewardShaping,
    VectorShapedReward,
)
from moe_policy.rollouts.environments import environments
from ocp_envs.problems.pendulum import PENDULUM
from tests.learners import ENV_ID, obstacle_envs, wrapped, wrapped_vector


def test_the_scalar_wrappers_change_what_is_seen_and_done_and_nothing_else():
    p = np.array([1.0, -0.5])
    env, bare = wrapped(), gym.make(ENV_ID)
    seen, _ = env.reset(options={"parameters": p})
    bare.reset(options={"parameters": p})
    np.testing.assert_allclose(seen, [np.sin(1), np.cos(1), -0.25], atol=1e-6)
    for action in ([0.3], [-1.0], [5.0]):
        seen, reward, *_ = env.step(np.array(action))
        observation, bare_reward, *_ = bare.step(np.clip(action, -1, 1))
        assert seen in env.observation_space
        np.testing.assert_array_equal(seen, Features(PENDULUM)(observation))
        assert reward == bare_reward


def test_the_vector_wrappers_agree_with_the_scalar_ones_row_by_row():
    rng = np.random.default_rng(1)
    envs, rows = wrapped_vector(4), [wrapped() for _ in range(4)]
    seen, _ = envs.reset(seed=5)
    np.testing.assert_array_equal(seen, [env.reset(seed=5 + i)[0] for i, env in enumerate(rows)])
    for _ in range(20):
        actions = rng.uniform(-1, 1, (4, 1))
        seen, rewards, *_ = envs.step(actions)
        single = [env.step(action) for env, action in zip(rows, actions)]
        np.testing.assert_array_equal(seen, [step[0] for step in single])
        np.testing.assert_array_equal(rewards, [step[1] for step in single])
    assert envs.single_observation_space == rows[0].observation_space
    assert envs.single_action_space == rows[0].action_space


def test_shaping_telescopes_and_scales():
    """Undiscounted, shaped returns of episodes that end differ by the first potential alone."""
    envs = gym.make_vec(
        "GroundVehicle-v0",
        num_envs=3,
        vectorization_mode="vector_entry_point",
        dt=0.1,
        autoreset_mode="Disabled",
        time_limit=1.0,
    )
    shaped = VectorShapedReward(envs, RewardShaping(reward_scale=0.5, shaping=4.0, gamma=1.0))
    p = np.array([[3.0, -4.0, 0.0, 0.0], [0.3, 0.0, 0.1, -0.5], [9.0, 9.0, 3.0, 3.0]])
    shaped.reset(options={"parameters": p})
    first = envs.unwrapped.problem.goal_error(envs.unwrapped.state)
    np.testing.assert_allclose(first[0], 5.0)
    total, cost, ended = np.zeros(3), np.zeros(3), np.zeros(3, bool)
    for _ in range(10):
        _, rewards, terminated, _, info = shaped.step(np.tile([0.1, 0.4], (3, 1)))
        total += rewards
        cost += info["cost"]
        ended |= terminated
    assert ended.tolist() == [False, True, False]  # the second enters the goal ball, where the potential is zero
    last = np.where(ended, 0.0, envs.unwrapped.problem.goal_error(envs.unwrapped.state))
    np.testing.assert_allclose(total, 0.5 * (-cost - 4.0 * last + 4.0 * first), rtol=1e-6)


def test_distance_has_its_price():
    rewards = []
    for price in (0.0, 3.0):
        envs = gym.make_vec(ENV_ID, num_envs=2, vectorization_mode="vector_entry_point", autoreset_mode="Disabled")
        priced = VectorShapedReward(envs, RewardShaping(reward_scale=0.5, distance_price=price))
        priced.reset(options={"parameters": np.array([[0.5, 0.0], [3.0, 1.0]])})
        rewards.append(priced.step(np.zeros((2, 1)))[1])
        base = envs.unwrapped
        distance = base.problem.goal_error(base.state)
    np.testing.assert_allclose(rewards[0] - rewards[1], 0.5 * 3.0 * base.dt * distance)


def test_what_one_step_costs_the_learner_can_be_bounded():
    """A pendulum that leaves its box is charged for the rest of the episode; the learner only for as much as is set."""
    rewards = {}
    for largest in (None, 30.0):
        envs = gym.make_vec(ENV_ID, num_envs=2, vectorization_mode="vector_entry_point", autoreset_mode="Disabled")
        bounded = VectorShapedReward(envs, RewardShaping(reward_scale=0.5, largest_cost=largest))
        leaving = PENDULUM.system.state.upper - [0.01, 1.0]
        bounded.reset(options={"parameters": np.array([[1.0, 0.0], leaving]), "extrapolate": True})
        rewards[largest] = np.array([bounded.step(np.zeros((2, 1)))[1] for _ in range(3)])
    assert rewards[None].min() < -15.0
    np.testing.assert_allclose(rewards[30.0], np.maximum(rewards[None], -15.0))


def test_arriving_has_its_bonus():
    rewards = []
    for bonus in (0.0, 7.0):
        envs = environments(PENDULUM, 2, terminate_at_goal=True)
        shaped = VectorShapedReward(envs, RewardShaping(reward_scale=0.5, arrival_bonus=bonus))
        shaped.reset(options={"parameters": np.array([[np.pi - 0.05, 0.0], [1.0, 0.0]]), "extrapolate": True})
        rewards.append(shaped.step(np.zeros((2, 1)))[1])
    np.testing.assert_allclose(rewards[1] - rewards[0], [3.5 * envs.unwrapped._terminated[0], 0.0])
    assert envs.unwrapped._terminated[0]


def test_violations_are_charged_at_their_price():
    p = np.array([0.0, 4.0, 4.0, 0.0, 4.0, 0.5, 3.4])  # falls into the sphere below
    rewards = []
    for price in (0.0, 50.0):
        envs = VectorShapedReward(obstacle_envs(1), RewardShaping(reward_scale=0.5, violation_price=price))
        envs.reset(options={"parameters": p[None]})
        charged = []
        for _ in range(20):
            _, reward, _, _, info = envs.step(np.zeros((1, 4)))
            charged.append((reward[0], info["violation"][0]))
        rewards.append(np.array(charged))
    free, priced = rewards
    assert priced[:, 1].max() > 0.1
    np.testing.assert_allclose(free[:, 0] - priced[:, 0], 0.5 * 50 * 0.02 * priced[:, 1], atol=1e-6)


def test_the_goal_error_is_computed_only_where_it_is_paid_for(monkeypatch):
    def refuse(*_):
        raise AssertionError("computed")

    for shaping, computed in ((RewardShaping(), False), (RewardShaping(shaping=1.0), True)):
        envs = VectorShapedReward(environments(PENDULUM, 2, terminate_at_goal=True), shaping)
        envs.reset(seed=0)
        context = pytest.raises(AssertionError, match="computed") if computed else contextlib.nullcontext()
        with monkeypatch.context() as patch, context:
            patch.setattr(type(PENDULUM), "goal_error", refuse)
            envs.step(np.zeros((2, 1)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reward_scale": 0.0}, "reward_scale must be positive"),
        ({"shaping": -1.0}, "shaping must be at least 0"),
        ({"violation_price": float("nan")}, "violation_price must be at least 0"),
        ({"largest_cost": 0.0}, "largest_cost must be positive or None"),
        ({"gamma": 1.5}, r"gamma must be in \(0, 1\]"),
    ],
)
def test_a_shaping_out_of_range_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        RewardShaping(**change)


@pytest.mark.parametrize("wrapper", [FeatureObservation, NormalisedAction])
def test_environments_of_others_are_refused(wrapper):
    with pytest.raises(TypeError, match="expected an environment of ocp_envs, wrapped or not; got PendulumEnv"):
        wrapper(gym.make("Pendulum-v1"))
