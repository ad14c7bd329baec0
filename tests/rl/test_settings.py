"""Settings build learners, extract their actors and refuse what is out of range."""

import dataclasses
import sys

import numpy as np
import pytest

from moe_policy import store
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.settings import SACSettings, TQCSettings
from moe_policy.rl.training import train, training_env
from moe_policy.rl.wrappers import Features
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from tests.learners import DEVELOPMENT, PPO, SAC, observations

TQC = TQCSettings(**dataclasses.asdict(SAC), dropped=3)


@pytest.mark.parametrize("settings", [SAC, PPO, TQC], ids=["sac", "ppo", "tqc"])
def test_the_rebuilt_actor_does_what_stable_baselines_does(settings, tmp_path):
    if settings is TQC:
        pytest.importorskip("sb3_contrib")
    learner = settings.learner(training_env(PENDULUM, settings))
    learner.learn(settings.steps)
    policy = LearnedPolicy(PENDULUM, settings.actor(learner), period=0.1, algorithm=settings.algorithm)
    policy.save(tmp_path / "rl")
    seen = observations(200)
    expected, _ = learner.predict(Features(PENDULUM)(seen), deterministic=True)
    assert np.ptp(expected) > 1e-3, "a constant would prove nothing"
    for candidate in (policy, store.load_file(tmp_path / "rl")):
        np.testing.assert_allclose(candidate.controls(seen), expected, atol=2e-6)


def test_the_first_actions_of_ppo_are_about_the_goals_control():
    """A quadcopter that begins with half thrust rises at once; one that hovers has time to learn."""
    settings = dataclasses.replace(PPO, hidden=(64, 64))
    learner = settings.learner(training_env(QUADCOPTER, settings))
    policy = LearnedPolicy(QUADCOPTER, settings.actor(learner), period=0.1, algorithm="ppo")
    np.testing.assert_allclose(policy.controls(np.zeros((1, 12))), [QUADCOPTER.goal.control], atol=0.1)


def test_tqc_tells_what_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    with pytest.raises(ImportError, match=r"pip install 'ocp-moe\[tqc\]'"):
        train(PENDULUM, TQC, DEVELOPMENT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gamma": 1.5}, "gamma"),
        ({"steps": 0}, "steps"),
        ({"final_learning_rate": 1.0}, "final_learning_rate"),
        ({"largest_cost": 0.0}, "largest_cost"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        SACSettings(**change)
