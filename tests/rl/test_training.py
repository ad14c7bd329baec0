"""Short trainings."""

import dataclasses

import numpy as np
import pytest

import ocp_envs
from moe_policy.control.stabiliser import Stabilised
from moe_policy.rl.settings import PPOSettings, SACSettings
from moe_policy.rl.training import train
from moe_policy.rollouts.rollout import rollout
from ocp_envs.goal import Goal
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.system import Box, Coordinate
from tests.learners import DEVELOPMENT, PPO, SAC, make_envs
from tests.small_problems import DOUBLE_INTEGRATOR


@pytest.mark.parametrize("settings", [SAC, PPO], ids=["sac", "ppo"])
def test_training_reports_and_keeps_the_best(settings):
    reports = []
    optimal = np.array([4.0, 0.3, 0.1, 3.0])
    run = train(PENDULUM, settings, DEVELOPMENT, optimal_costs=optimal, on_evaluation=reports.append)
    assert [e.steps for e in run.curve] == [settings.evaluate_every, 2 * settings.evaluate_every]
    assert [len(r.curve) for r in reports] == [1, 2]
    assert run.best.score == min(e.score for e in run.curve)
    assert not any(evaluation.better_than(run.best) for evaluation in run.curve)
    assert run.policy.details["steps"] == run.best.steps
    assert run.settings == settings
    assert run.curve[-1].seconds > 0
    episodes = rollout(make_envs(PENDULUM, 4), Stabilised(run.policy, PENDULUM), DEVELOPMENT)
    failed = 2 * PENDULUM.time_limit  # the largest cost rate of the pendulum is 2
    assert run.best.score == pytest.approx(np.where(episodes.success, episodes.cost, failed).mean())
    assert run.best.success == episodes.success.sum()
    assert run.best.mean_return == pytest.approx(-episodes.cost.mean())
    assert run.best.violation is None
    if episodes.success.any():
        ratio = episodes.cost[episodes.success].sum() / optimal[episodes.success].sum()
        assert run.best.cost_ratio == pytest.approx(ratio)


def test_training_is_reproducible():
    runs = [train(PENDULUM, SAC, DEVELOPMENT) for _ in range(2)]
    first, second = (run.policy.actor for run in runs)
    for one, other in zip((*first.weights, *first.biases), (*second.weights, *second.biases), strict=True):
        np.testing.assert_array_equal(one, other)


#: A goal wide enough to be found by chance, so that what is tested is the learning and not the exploration.
WIDE_GOAL = dataclasses.replace(
    DOUBLE_INTEGRATOR,
    id="WideGoal-v0",
    parameters=Box((Coordinate("x", -2.0, 2.0, "m"), Coordinate("v", -0.5, 0.5, "m/s"))),
    goal=Goal(state=[0.0, 0.0], radius=0.4, windings=[[0, 0]], control=[0.0]),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        SACSettings(steps=12_000, learning_starts=2_000, evaluate_every=3_000),
        PPOSettings(steps=150_000, evaluate_every=50_000),
    ],
    ids=["sac", "ppo"],
)
def test_both_learners_move_a_mass_and_stop(settings):
    ocp_envs.register(WIDE_GOAL)
    box = WIDE_GOAL.parameters
    development = np.random.default_rng(0).uniform(box.lower, box.upper, (100, 2))
    assert train(WIDE_GOAL, settings, development).best.success >= 95
