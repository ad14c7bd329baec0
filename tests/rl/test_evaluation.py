"""Evaluations against counts by hand and against the environment."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from moe_policy.control.stabiliser import Stabilised
from moe_policy.rl.evaluation import Performance
from moe_policy.rl.training import train
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.pendulum import PENDULUM
from tests.learners import DEVELOPMENT, SAC, make_envs, random_policy


def test_metrics_of_episodes_add_up():
    """From hand-made episodes: two successes, one that entered the goal ball and left it, one that left the box."""
    policy = Stabilised(random_policy(), PENDULUM)
    episodes = dataclasses.replace(
        rollout(make_envs(PENDULUM, 4), policy, DEVELOPMENT),
        success=np.array([True, True, False, False]),
        reached=np.array([True, True, True, False]),
        cost=np.array([2.0, 4.0, 1.0, 40.0]),
    )
    found = Performance.of(PENDULUM, episodes, np.array([1.0, 4.0, 100.0, 100.0]))
    assert dataclasses.asdict(found) == {
        "success": 2,
        "reached": 3,
        "cost": 3.0,
        "score": (2.0 + 4.0 + 40.0 + 40.0) / 4,
        "cost_ratio": 6.0 / 5.0,
        "mean_return": -47.0 / 4,
        "violation": None,
        "final_error": float(np.median(episodes.final_error)),
    }
    none = Performance.of(PENDULUM, dataclasses.replace(episodes, success=np.zeros(4, bool)), np.ones(4))
    assert (none.cost, none.cost_ratio) == (None, None)
    assert Performance.of(PENDULUM, episodes).cost_ratio is None


@pytest.mark.parametrize("costs", [np.ones(3), np.array([1.0, 1.0, 0.0, 1.0]), np.array([1.0, np.nan, 1.0, 1.0])])
def test_optimal_costs_must_be_one_a_start_and_positive(costs):
    with pytest.raises(ValueError, match="one positive optimal cost for each of 4"):
        train(PENDULUM, SAC, DEVELOPMENT, optimal_costs=costs)


def test_the_return_of_an_evaluation_is_what_the_environment_charges():
    """Summed in the environment itself, at the control period of the evaluation, with the goal as its end."""
    policy = random_policy()
    evaluated = rollout(make_envs(PENDULUM, 4), Stabilised(policy, PENDULUM), DEVELOPMENT)
    env, returns = gym.make(PENDULUM.id), []
    for p in DEVELOPMENT:
        observation, _ = env.reset(options={"parameters": p})
        state, over, total = None, bool(PENDULUM.goal_error(p) < PENDULUM.goal.radius), 0.0
        while not over:
            action, state = policy.predict(observation, state=state)
            observation, reward, terminated, truncated, _ = env.step(action)
            over, total = terminated or truncated, total + reward
        returns.append(total)
    assert Performance.of(PENDULUM, evaluated).mean_return == pytest.approx(np.mean(returns), abs=1e-4)
