import numpy as np
import pytest

from moe_policy.experiments import partitions
from moe_policy.experiments.partitions import PARTITION_COLUMNS, PartitionModel, PartitionRow, partition
from moe_policy.learning.settings import TrainingSettings
from moe_policy.reports.records import ABSENT
from moe_policy.reports.tables import markdown_table
from tests.synthetic import fake_samples

SETTINGS = TrainingSettings(epochs=2)


@pytest.fixture(scope="module")
def samples():
    return fake_samples(200)


@pytest.fixture(autouse=True)
def _briefly(monkeypatch):
    monkeypatch.setattr(partitions, "FIRST_EPOCHS", 2)
    monkeypatch.setattr(partitions, "ROUNDS", 2)


@pytest.mark.parametrize(("name", "k"), [("cuts", 3), ("residuals", 2), ("competition", 2), ("kmeans", 2)])
def test_every_partition_splits_all_samples_again_in_the_same_way(samples, name, k):
    labels = partition(samples, name, k, SETTINGS)
    assert labels.sizes.sum() == len(samples)
    assert 1 < labels.k <= k
    np.testing.assert_array_equal(labels.values, partition(samples, name, k, SETTINGS).values)


def test_the_declared_families_are_a_partition(samples):
    np.testing.assert_array_equal(partition(samples, "custom", 9, SETTINGS).values, samples.mode)


def test_in_a_competition_an_instance_goes_to_the_expert_that_errs_least(monkeypatch, samples):
    """With a gate that does not matter, parts are those of the errors of the last round."""
    monkeypatch.setattr(partitions, "TEMPERATURE", 1e-9)
    errors = iter(np.random.default_rng(0).random((4, len(samples))))
    kept = []

    def some(learner, x, y):
        kept.append(next(errors))
        return partitions.torch.from_numpy(kept[-1])

    monkeypatch.setattr(partitions._Learner, "errors", some)
    found = partition(samples, "competition", 2, SETTINGS).values
    np.testing.assert_array_equal(found, np.argmin(kept[-2:], axis=0))


def test_a_row_has_the_median_and_range_over_the_seeds():
    models = [
        PartitionModel(
            name="reaction",
            together=0.5,
            seed=seed,
            sizes=(3, 4),
            gate_accuracy=accuracy,
            test_error=0.1,
            training_seconds=2.0,
            metrics={"violation_mean": 0.1 * (seed + 1)},
        )
        for seed, accuracy in ((0, 0.5), (1, 0.7), (2, None))
    ]
    row = PartitionRow.of(models, ABSENT)
    assert PartitionRow.from_json(row.to_json()) == row
    head, _, line = markdown_table([row], PARTITION_COLUMNS).splitlines()
    assert "mean violation on the whole path, m" in head
    assert line == "| reaction | 2 | 0.5 | 0.200 (0.100–0.300) | 0.600 | 0.1000 | 2 |"
