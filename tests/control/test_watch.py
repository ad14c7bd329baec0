"""What a policy sees in the first control steps: another episode, another control period, other actions."""

import re
from functools import cache

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers

import moe_policy
from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.watch import BLOCK, LAST
from ocp_envs.envs.env import Env
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from tests.learners import random_policy

PROBLEMS = [PENDULUM, VEHICLE, QUADCOPTER, QUADCOPTER_OBSTACLE]


@cache
def nearest(problem):
    return TrackingPolicy(problem, moe_policy.load(problem, "nearest"))


def run(env, policy, steps=25, seeds=3):
    """Run single episodes as Stable-Baselines3 does."""
    state = None
    for seed in range(seeds):
        observation, _ = env.reset(seed=seed)
        for step in range(steps):
            action, state = policy.predict(observation, state, np.array([step == 0]))
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                break


def episodes_of(policy, mode, rows=6, steps=400):
    envs = VectorEnv(PENDULUM, rows, mode)
    observation, _ = envs.reset(seed=0)
    state, start, count, reached = None, np.ones(rows, bool), 0, 0
    for _ in range(steps):
        action, state = policy.predict(observation, state, start)
        observation, _, terminated, truncated, _ = envs.step(action)
        start = terminated | truncated
        count += start.sum()
        reached += terminated.sum()
    return count, reached


def test_episodes_may_be_told_to_start_with_the_end_of_the_last_one():
    """Gymnasium's default mode: the step after the end resets, so the flag comes with the last observation."""
    for policy in (nearest(PENDULUM), Stabilised(Stabiliser(PENDULUM), PENDULUM)):
        same, following = (episodes_of(policy, mode) for mode in ("SameStep", "NextStep"))
        assert same[0] > 6
        assert following[0] == pytest.approx(same[0], rel=0.1)
        assert following[1] == pytest.approx(same[1], rel=0.1)


def test_a_decision_made_at_the_end_of_an_episode_is_not_held_in_the_next():
    policy = random_policy()
    envs = VectorEnv(PENDULUM, 2, time_limit=0.1)
    observation, _ = envs.reset(seed=1)
    state, start = None, np.ones(2, bool)
    for step in range(7):
        action, state = policy.predict(observation, state, start)
        if step == 6:
            np.testing.assert_allclose(action, policy.controls(observation), rtol=1e-6)
        observation, _, terminated, truncated, _ = envs.step(action)
        start = terminated | truncated


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)
@pytest.mark.parametrize("dt", [0.01, 0.04, 0.05])
def test_another_control_period_is_noticed(problem, dt):
    with pytest.raises(ValueError, match=r"move as in control steps of .* s, expected 0.02 s: make") as caught:
        run(Env(problem, dt=dt), nearest(problem))
    assert float(re.search(r"steps of (\S+) s", str(caught.value))[1]) == pytest.approx(dt, rel=0.15)


def test_actions_that_are_rescaled_are_noticed():
    with pytest.raises(ValueError, match=r"moves as under actions rescaled from \[-1, 1\]"):
        run(wrappers.RescaleAction(Env(VEHICLE), -1.0, 1.0), nearest(VEHICLE))


def test_stable_baselines_meets_the_error():
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    with pytest.raises(ValueError, match=r"move as in control steps of 0.05 s"):
        evaluation.evaluate_policy(nearest(PENDULUM), gym.make(PENDULUM.id, dt=0.05), 2, warn=False)


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)
@pytest.mark.parametrize(
    "imperfections",
    [
        {},
        {"disturbance": 0.5},
        {"observation_noise": 0.02},
        {"observation_noise": 1.0},
        {"delay": 3},
        {"disturbance": 3.0, "observation_noise": 0.001, "delay": 1},
    ],
    ids=str,
)
def test_imperfect_plants_raise_no_alarm(problem, imperfections):
    name, nominal = next(iter(problem.system.constants.items()))
    run(Env(problem, constants={name: 1.5 * nominal}, **imperfections), nearest(problem), seeds=4)


def test_observations_that_stand_still_raise_no_alarm():
    policy, seen, state = nearest(PENDULUM), np.array([[1.0, 0.5]], np.float32), None
    for _ in range(15):
        _, state = policy.predict(seen, state)


def test_an_episode_is_watched_for_some_control_steps_and_the_next_one_again():
    policy, env, state = nearest(PENDULUM), Env(PENDULUM), None
    observation, _ = env.reset(seed=0)
    kept = []
    for step in range(LAST + 3):
        action, state = policy.predict(observation, state, np.array([step == 0]))
        observation, *_ = env.step(action)
        kept.append(len(state.seen.steps))
    assert kept == [*range(1, BLOCK), *[BLOCK] * (LAST - BLOCK + 1), 0, 0, 0]
    assert state.seen.over
    assert state.seen.blocks == LAST // BLOCK
    _, state = policy.predict(observation, state, np.array([True]))
    assert (state.seen.over, len(state.seen.steps), state.seen.blocks) == (False, 1, LAST // BLOCK)


def test_what_the_caller_overwrites_is_remembered_as_it_was():
    policy, seen = nearest(PENDULUM), np.array([[1.0, 0.5]])
    action, state = policy.predict(seen)
    expected = action.copy()
    seen[:], action[:] = np.nan, np.nan
    np.testing.assert_array_equal(state.seen.steps[-1].observations, [[1.0, 0.5]])
    np.testing.assert_array_equal(state.seen.steps[-1].actions, expected)
