"""Episodes as datasets of Minari: made, loaded and simulated again by Minari itself."""

from __future__ import annotations

import numpy as np
import pytest

import moe_policy
from moe_policy.rollouts.minari_datasets import export_minari, read_minari, resimulate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE

minari = pytest.importorskip("minari")
pytest.importorskip("h5py")


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER_OBSTACLE], ids=lambda problem: problem.id)
def test_a_dataset_repeats_the_episodes_of_the_tracked_optimum(problem):
    stored = moe_policy.load(problem, "nearest", kind=moe_policy.NearestPlanner)
    policy = moe_policy.TrackingPolicy(problem, stored, dt=0.05)
    export_minari(problem, policy, stored.parameters[:3], "ocp/test-v0", dt=0.05)
    dataset = minari.load_dataset("ocp/test-v0")
    assert dataset.total_episodes == 3
    assert dataset.recover_environment().spec.id == problem.id
    assert all(episode.terminations[-1] for episode in dataset.iterate_episodes())
    assert resimulate(dataset, problem) < 1e-6
    decisions = read_minari("ocp/test-v0")
    assert len(decisions.actions) == len(decisions.observations) == dataset.total_steps
    assert decisions.observations.shape[1] == problem.system.nx + len(problem.context)
    np.testing.assert_array_equal(np.unique(decisions.episodes), [0, 1, 2])


def test_episodes_under_a_disturbance_can_be_repeated():
    policy = moe_policy.load(PENDULUM, "stabiliser")
    p = [[3.0, 0.0], [3.0, 0.0]]
    dataset = export_minari(PENDULUM, policy, p, "ocp/disturbed-v0", disturbance=[0.0, 0.5], seed=7)
    first, second = (episode.observations for episode in dataset.iterate_episodes())
    assert not np.array_equal(first[:5], second[:5])
    assert resimulate("ocp/disturbed-v0", PENDULUM) < 1e-6


@pytest.mark.parametrize("name", ["", "mine", "mine-v", "a b-v0"])
def test_names_without_a_version_are_refused(name):
    with pytest.raises(ValueError, match="dataset_id: expected words and a version"):
        export_minari(PENDULUM, moe_policy.load(PENDULUM, "stabiliser"), [[3.0, 0.0]], name)


def test_what_is_no_dataset_of_the_problem_is_refused():
    export_minari(PENDULUM, moe_policy.load(PENDULUM, "stabiliser"), [[3.0, 0.0]], "ocp/test-v0")
    with pytest.raises(ValueError, match="expected one of QuadcopterObstacle-v0"):
        resimulate("ocp/test-v0", QUADCOPTER_OBSTACLE)
    with pytest.raises(TypeError, match=r"expected a minari\.MinariDataset or the id of one, got a int"):
        read_minari(3)


def test_a_stateless_policy_is_exported_as_well():
    policy = moe_policy.load(PENDULUM, "stabiliser")
    dataset = export_minari(PENDULUM, policy, [[3.0, 0.0]], "ocp/regulator-v0")
    assert dataset.total_episodes == 1
    with pytest.raises(ValueError, match="ocp/regulator-v0"):
        export_minari(PENDULUM, policy, [[3.0, 0.0]], "ocp/regulator-v0")
