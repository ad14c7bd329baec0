from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from moe_policy.learning import clustering
from moe_policy.learning.clustering import Labels, cluster, without_small
from ocp_envs.data.continuation import Continuation
from ocp_envs.data.database import Database
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.data.samples import Samples, samples_of
from ocp_envs.trajectory import Trajectory
from tests.synthetic import FakeDatabase, fake_samples


def agree(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two partitions are the same up to the names of their clusters."""
    pairs = set(zip(a.tolist(), b.tolist()))
    return len(pairs) == len(set(a.tolist())) == len(set(b.tolist()))


def test_custom_clusters_are_the_modes():
    samples = fake_samples(modes=3)
    labels = cluster(FakeDatabase(samples), "custom")
    np.testing.assert_array_equal(labels.values, samples.mode)
    assert labels.names == samples.problem.modes.names
    assert labels.sizes.tolist() == np.bincount(samples.mode).tolist()


def test_modes_that_do_not_occur_are_left_out_and_names_kept():
    samples = fake_samples(modes=3)
    kept = samples.mode != 1
    labels = cluster(samples[kept], "custom")
    assert labels.k == 2
    assert labels.names == (samples.problem.modes.names[0], samples.problem.modes.names[2])
    assert set(labels.values) == {0, 1}


@pytest.mark.parametrize("arguments", [{"method": "kmeans"}, {"method": "kmeans-pca", "components": 3}])
def test_kmeans_finds_families_that_lie_apart(arguments):
    samples = fake_samples(modes=3)
    noise = np.random.default_rng(0).normal(size=(len(samples.mode), 75))
    levels = np.array([0.0, 20.0, 35.0])[samples.mode]
    apart = Trajectory.from_flat(levels[:, None] + noise, 25, 2, 1)
    labels = cluster(dataclasses.replace(samples, trajectory=apart), k=3, **arguments)
    assert agree(labels.values, samples.mode)
    assert labels.settings["n_init"] == 10


def test_kmeans_is_decided_by_its_seed():
    samples = fake_samples()
    first, again = (cluster(samples, "kmeans", k=5, seed=3).values for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_projection_on_all_components_changes_nothing():
    samples = fake_samples(count=200, jump=60.0)
    plain = cluster(samples, "kmeans", k=2)
    projected = cluster(samples, "kmeans-pca", k=2, components=75)
    assert agree(plain.values, projected.values)
    assert projected.settings["explained"] == pytest.approx(1)


def continuing(samples: Samples) -> Continuation:
    """All neighbours of one mode continue into each other."""
    pairs = neighbour_pairs(samples.problem.parameters, samples.parameters, 8)
    apart = samples.mode[pairs[:, 0]] != samples.mode[pairs[:, 1]]
    distance = np.repeat(apart[:, None], 2, axis=1).astype(np.float32)
    return Continuation(pairs, distance, distance, np.ones_like(distance, dtype=np.int32))


def test_families_are_found_by_continuation_and_not_declared(monkeypatch, tmp_path):
    samples, asked = fake_samples(modes=3), []

    def noted(given, kept, *, neighbours, executor):
        asked.append(kept)
        return continuing(given)

    monkeypatch.setattr(clustering, "continued", noted)
    labels = cluster(FakeDatabase(samples), "continuation", kept=tmp_path)
    assert agree(labels.values, samples.mode)
    assert labels.sizes.tolist() == sorted(labels.sizes.tolist(), reverse=True)
    assert labels.names == ("family 0", "family 1", "family 2")
    assert (labels.settings["components"], labels.settings["cuts"], labels.settings["merged"]) == (3, [], 0)
    assert labels.settings["thinnest_rejected_cut"] > labels.settings["width"]
    assert asked == [tmp_path]
    finer = cluster(samples, "continuation", k=5)
    assert asked[-1] is None
    assert finer.k == 5
    assert all(len(set(samples.mode[finer.values == part])) == 1 for part in range(5))
    with pytest.raises(ValueError, match="k: got 2, but 3 families were found"):
        cluster(samples, "continuation", k=2)
    with pytest.raises(ValueError, match=r"k: expected a whole number in 1 … 400"):
        cluster(samples, "continuation", k=401)


def test_the_solves_of_a_database_are_kept_beside_it(monkeypatch, tmp_path):
    samples = fake_samples(modes=2, count=60)
    database = Database.create(tmp_path / "training.zarr", samples.problem, samples.parameters)
    monkeypatch.setattr(Database, "samples", lambda self: samples)
    kept = []
    monkeypatch.setattr(clustering, "continued", lambda given, to, **_: kept.append(to) or continuing(given))
    cluster(database, "continuation")
    assert kept == [tmp_path / "training.continuation"]


def test_wrong_arguments_are_named():
    samples = fake_samples(count=20)
    with pytest.raises(ValueError, match="did you mean 'kmeans'"):
        cluster(samples, "k-means", k=3)
    with pytest.raises(ValueError, match="'k' is needed"):
        cluster(samples, "kmeans")
    with pytest.raises(ValueError, match="'k' is needed"):
        cluster(samples, "custom", k=3)
    with pytest.raises(ValueError, match="'components' is needed"):
        cluster(samples, "kmeans-pca", k=3)
    with pytest.raises(ValueError, match="k: expected a whole number in 1 … 20, got 21"):
        cluster(samples, "kmeans", k=21)


@pytest.mark.parametrize(
    ("arguments", "error", "name"),
    [
        ({"k": 0}, ValueError, "k"),
        ({"k": -3}, ValueError, "k"),
        ({"k": 2.5}, TypeError, "k"),
        ({"k": True}, TypeError, "k"),
        ({"k": 2, "seed": -1}, ValueError, "seed"),
        ({"k": 2, "n_init": 0}, ValueError, "n_init"),
        ({"k": 2, "n_init": "many"}, TypeError, "n_init"),
    ],
)
def test_wrong_numbers_are_named(arguments, error, name):
    with pytest.raises(error, match=f"^{name}: expected a whole number"):
        cluster(fake_samples(count=20), "kmeans", **arguments)


def test_unusable_samples_are_refused():
    samples = fake_samples(count=20)
    states = samples.trajectory.states.copy()
    states[3] = np.nan
    holed = Trajectory(states, samples.trajectory.controls, samples.trajectory.duration)
    with pytest.raises(ValueError, match="1 of 20 trajectories are not finite"):
        samples_of(dataclasses.replace(samples, trajectory=holed))
    with pytest.raises(ValueError, match="at least one sample"):
        samples_of(samples[:0])
    with pytest.raises(ValueError, match="finite"):
        samples_of(dataclasses.replace(samples, parameters=samples.parameters * np.nan))
    with pytest.raises(TypeError, match="Database"):
        samples_of(np.ones(3))


def test_a_database_without_a_solution_says_so():
    class Unsolved:
        def __len__(self):
            return 5

        def samples(self):
            return fake_samples(count=5)[:0]

    with pytest.raises(ValueError, match="none of its 5 instances is solved"):
        samples_of(Unsolved())


def test_labels_are_checked():
    with pytest.raises(ValueError, match="each of 0 … 1"):
        Labels(np.array([0, 0, 2]), ("a", "b"), "custom")
    with pytest.raises(ValueError, match="integers"):
        Labels(np.array([0.0, 1.0]), ("a", "b"), "custom")
    with pytest.raises(ValueError, match="each of 0 … 1"):
        Labels(np.array([0, -1]), ("a", "b"), "custom")
    for names in ((), "ab"):
        with pytest.raises((TypeError, ValueError), match="a name for each cluster"):
            Labels(np.array([0, 1]), names, "custom")


def test_a_cluster_too_small_to_learn_from_joins_the_nearest_one():
    samples = fake_samples(60, modes=3)
    values = samples.mode.copy()
    few = np.flatnonzero(values == 1)[:3]
    values[few] = 3
    joined = without_small(samples, Labels(values, ("a", "b", "c", "d"), "own"), 10)
    np.testing.assert_array_equal(joined.values, samples.mode)
    assert joined.names == ("a", "b", "c")
    assert joined.settings["least"] == 10
    everything = without_small(samples, Labels(values, ("a", "b", "c", "d"), "own"), 61)
    assert (everything.k, len(everything)) == (1, 60)
    assert without_small(samples, joined, 2) is joined


def test_strays_are_in_a_cluster_and_of_no_family():
    labels = Labels(np.array([0, 1, 1]), ("a", "b"), "own", strays=np.array([False, True, False]))
    assert labels.families.tolist() == [0, -1, 1]
    assert labels.sizes.tolist() == [1, 2]
    assert Labels(np.array([0, 1]), ("a", "b"), "own").families.tolist() == [0, 1]


def test_strays_of_other_samples_are_refused():
    with pytest.raises(ValueError, match=r"strays: expected truth values \(2,\)"):
        Labels(np.array([0, 1]), ("a", "b"), "own", strays=np.array([True]))
