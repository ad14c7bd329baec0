"""Behaviour cloning."""

import dataclasses

import numpy as np

from moe_policy import store
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.rl.cloning import CloningSettings, clone, demonstrations
from moe_policy.rl.settings import ClonedPPOSettings
from moe_policy.rl.training import train
from ocp_envs.problems.pendulum import PENDULUM
from tests.learners import DEVELOPMENT

SETTINGS = CloningSettings(steps=3_000, period=0.1, hidden=(16,), epochs=3, batch_size=64)


def stored():
    return store.load(PENDULUM, "nearest", kind=NearestPlanner)


def test_demonstrations_are_decisions_before_the_goal_ball_and_no_more_than_asked_for():
    shown = demonstrations(PENDULUM, SETTINGS, stored())
    assert 2_900 < len(shown.controls) <= 3_000
    assert 10 < shown.episodes < len(stored().parameters)
    assert shown.observations.shape == (len(shown.controls), 2)
    assert (PENDULUM.goal_error(shown.observations) >= PENDULUM.goal.radius).all()
    again = demonstrations(PENDULUM, dataclasses.replace(SETTINGS, disturbance=0.1), stored())
    assert not np.array_equal(again.observations[:100], shown.observations[:100])


def test_a_clone_is_a_policy_from_which_ppo_can_begin():
    run = clone(PENDULUM, SETTINGS, stored(), DEVELOPMENT)
    assert run.policy.details["steps"] == run.best.steps == run.curve[-1].steps
    assert run.settings.complete(run.best.steps)
    settings = ClonedPPOSettings(
        steps=256, n_envs=8, n_steps=16, batch_size=64, hidden=(16,), evaluate_every=128, critic_steps=512
    )
    further = train(PENDULUM, settings, DEVELOPMENT, begin=run.policy)
    np.testing.assert_array_equal(further.policy.actor.weights[0], run.policy.actor.weights[0])
    moved = train(PENDULUM, dataclasses.replace(settings, critic_steps=0), DEVELOPMENT, begin=run.policy)
    assert not np.array_equal(moved.policy.actor.weights[0], run.policy.actor.weights[0])
