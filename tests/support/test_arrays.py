"""Large arrays in files: the same values as in memory, and nothing left behind."""

import gc
import tempfile

import numpy as np
import pytest

from moe_policy.learning import clustering
from moe_policy.learning.clustering import cluster
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.planners import scaling
from ocp_envs.support import arrays
from tests.synthetic import fake_samples


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_large_arrays_hold_what_is_written_and_leave_no_file(dtype, monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    values = np.random.default_rng(0).random((100, 7)).astype(dtype)
    for large in (0, 10**9):
        monkeypatch.setattr(arrays, "LARGE", large)
        array = arrays.scratch(values.shape, dtype)
        array[:] = values
        assert array.dtype == dtype
        np.testing.assert_array_equal(array[[3, 50]], values[[3, 50]])
        assert not list(tmp_path.iterdir())
        del array
    gc.collect()


def test_a_training_from_files_is_the_training_from_memory(monkeypatch):
    samples, settings = fake_samples(300), TrainingSettings(epochs=3)
    labels = cluster(samples, "custom")

    def weights():
        planners = fit_single(samples, settings=settings), fit_mixture(samples, labels, settings=settings)
        return [value for planner in planners for value in planner.network.tensors().values()]

    within = weights()
    monkeypatch.setattr(arrays, "LARGE", 0)
    for expected, found in zip(within, weights()):
        np.testing.assert_array_equal(found, expected)


def test_scalers_of_blocks_are_those_of_all_rows(monkeypatch):
    values = np.random.default_rng(1).normal(5.0, 3.0, (1000, 4))
    whole = scaling.Standardizer.fit(values)
    monkeypatch.setattr(scaling, "BLOCK", 64)
    parts = scaling.Standardizer.fit(values)
    np.testing.assert_allclose(parts.mean, values.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(parts.std, values.std(axis=0), rtol=1e-13)
    np.testing.assert_array_equal(whole.mean, values.mean(axis=0))
    np.testing.assert_array_equal(whole.std, values.std(axis=0))


def test_clusters_found_on_some_samples_take_in_the_others(monkeypatch):
    samples = fake_samples(300, jump=200.0)
    every = cluster(samples, "kmeans", k=2)
    monkeypatch.setattr(clustering, "FITTED", 100)
    some = cluster(samples, "kmeans", k=2)
    assert some.settings["fitted_on"] == 100
    # The same partition under other numbers: the families lie far apart.
    pairs = set(zip(every.values.tolist(), some.values.tolist()))
    assert len(pairs) == 2
