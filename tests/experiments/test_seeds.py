"""Models over training seeds, from small trainings and from made-up ones."""

import pytest

from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.seeds import Model, Paper, Range, Training, TrainingRow
from moe_policy.learning.clustering import cluster
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.reports.records import ABSENT
from tests.synthetic import fake_samples

QUICK = TrainingSettings(epochs=2)


def model(seed, success=10, samples=20, violation=None):
    training = Training(seed=seed, samples=samples, test_error=0.01, training_seconds=1.0)
    return Model(
        training=training,
        success=success,
        success_at_plan_end=success // 2,
        reached=success,
        violation=violation,
        knot_violation=violation,
        validation_error=0.02,
    )


def test_a_training_is_recorded_as_it_was():
    samples = fake_samples(200, modes=3)
    single = fit_single(samples, settings=QUICK, seed=4)
    mixture = fit_mixture(samples, cluster(samples, "custom"), settings=QUICK, seed=4)
    for planner, parts in ((single, 1), (mixture, 3)):
        training = Training.of(planner)
        assert (training.seed, training.samples, len(training.part_test_errors)) == (4, 200, parts)
        assert training.test_error == planner.report.test_error
        assert training.peak_memory_gb > 0.05
        assert Training.from_json(training.to_json()) == training
    assert (Training.of(single).gate_accuracy, Training.of(single).cluster_sizes) == (None, None)
    assert sum(Training.of(mixture).cluster_sizes) == 200


def test_rows_hold_medians_over_seeds_and_the_papers_values():
    models = [model(seed, success) for seed, success in enumerate((3, 9, 5))]
    row = TrainingRow.of("snn", models, Published(validation_error=0.5, success=7))
    assert (row.seeds, row.samples, row.success) == ((0, 1, 2), 20, (3, 9, 5))
    assert row.success_spread == Range(median=5.0, minimum=3, maximum=9)
    assert row.success_spread.to_json() == {"median": 5.0, "least": 3, "most": 9}
    assert row.paper == Paper(success=7, validation_error=0.5)
    assert row.violation_spread is ABSENT
    assert TrainingRow.of("snn", [model(0, violation=0.5)]).violation_spread == Range(
        median=0.5, minimum=0.5, maximum=0.5
    )


def test_what_an_older_row_lacks_comes_from_the_shipped_model():
    row = TrainingRow.of("snn", [model(0), model(1)])
    old = TrainingRow.from_json({k: v for k, v in row.to_json().items() if k not in ("gate_accuracy", "cluster_sizes")})
    shipped = Training(
        seed=0, samples=20, test_error=9.0, training_seconds=9.0, gate_accuracy=0.9, cluster_sizes=(5, 15)
    )
    filled = old.with_training(shipped)
    assert (filled.shipped_seed, filled.gate_accuracy, filled.cluster_sizes) == ((0,), (0.9,), ((5, 15),))
    assert filled.test_error == (0.01, 0.01)  # its own


@pytest.mark.parametrize("values", [(), (None, None)])
def test_a_metric_that_a_problem_lacks_has_no_range(values):
    assert Range.of(values) is ABSENT
