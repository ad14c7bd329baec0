"""Records of trainings: what they say of a run, and which of them belong together."""

import dataclasses

import pytest

from moe_policy.experiments.learners import CaseSet, LearnerRun, Search, Trial, learner_trainings, training_file
from moe_policy.reports.records import ABSENT, read, write
from moe_policy.rl.evaluation import Evaluation
from moe_policy.rl.settings import PPOSettings, SACSettings
from moe_policy.rl.training import TrainingRun
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support.provenance import provenance
from tests.experiments.learner_records import keep, training
from tests.learners import random_policy


def test_records_are_found_by_algorithm_and_seed(tmp_path):
    for seed in (0, 10, 2):
        keep(tmp_path, training(SACSettings(steps=200, seed=seed), [1, seed]))
    old = training(PPOSettings(steps=200), [25, 50])
    del old.run.settings["violation_price"]  # an old record lacks what came later
    keep(tmp_path, old)
    keep(tmp_path, dataclasses.replace(old, env_id=VEHICLE.id))
    found = learner_trainings(tmp_path, PENDULUM)
    assert list(found) == ["ppo", "sac"]
    assert [seed.seed for seed in found["sac"]] == [0, 2, 10]
    assert found["ppo"][0].run.learner == PPOSettings(steps=200)


def test_seeds_of_other_settings_are_refused(tmp_path):
    keep(tmp_path, training(SACSettings(steps=200), [1, 2]))
    keep(tmp_path, training(SACSettings(steps=200, gamma=0.9, seed=1), [1, 2]))
    with pytest.raises(ValueError, match=r"_seed1\.json has other settings .*: gamma 0\.995 and 0\.9"):
        learner_trainings(tmp_path, PENDULUM)


def test_the_record_of_a_run_is_read_as_it_was_written(tmp_path):
    performance = {"success": 1, "reached": 2, "cost": 3.0, "score": 4.0, "mean_return": -5.0, "final_error": 0.1}
    performance |= {"cost_ratio": None, "violation": None}
    points = [Evaluation(steps=steps, seconds=0.5 * steps, closest=0.5, **performance) for steps in (100, 180)]
    settings = SACSettings(steps=200, hidden=(8, 8))
    trained = TrainingRun(settings, random_policy(), points[0], tuple(points))
    run = LearnerRun.of(trained, CaseSet(name="development", count=2), provenance())
    assert (run.steps, run.seconds, run.best.steps, run.complete) == (180, 90.0, 100, False)
    path = tmp_path / "search.json"
    write(path, Search(env_id=PENDULUM.id, trials=(Trial(note="wide", run=run),)))
    (again,) = read(path, Search).trials
    assert again.run.learner == settings
    assert again.run.curve == run.curve
    assert (again.run.best.mean_return, again.run.development.planners) == (-5.0, ABSENT)


def test_only_the_first_seed_has_no_suffix():
    assert training_file("sac", "X-v0", 0) == "training_sac_X-v0.json"
    assert training_file("sac", "X-v0", 3) == "training_sac_X-v0_seed3.json"
