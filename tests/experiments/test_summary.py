"""The paper's tables and the overview, from made-up records."""

import dataclasses

import numpy as np

from moe_policy.experiments.benchmark import BENCHMARKS
from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.summary import row_of, summarised, training_record
from moe_policy.learning.clustering import cluster
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from ocp_envs.problems import BENCHMARK
from tests.synthetic import fake_samples

QUICK = TrainingSettings(epochs=2)


def test_a_training_is_recorded_as_it_was():
    samples = fake_samples(200, modes=3)
    single, mixture = (
        fit_single(samples, settings=QUICK, seed=4),
        fit_mixture(samples, cluster(samples, "custom"), settings=QUICK, seed=4),
    )
    for planner, parts in ((single, 1), (mixture, 3)):
        record = training_record(planner)
        assert (record["seed"], record["samples"], len(record["part_test_errors"])) == (4, 200, parts)
        assert record["test_error"] == planner.report.test_error
        assert record["peak_memory_gb"] > 0.05
    assert training_record(single)["gate_accuracy"] is None
    assert sum(training_record(mixture)["cluster_sizes"]) == 200


def test_rows_hold_medians_over_seeds_and_the_papers_figures():
    records = [{"seed": seed, "samples": 10, "success": count} for seed, count in enumerate((3, 9, 5))]
    row = row_of("snn", records, Published(validation_error=0.5, success=7))
    assert (row["seeds"], row["samples"]) == ([0, 1, 2], 10)
    assert row["success_spread"] == {"median": 5.0, "least": 3, "most": 9}
    assert (row["paper_success"], row["paper_validation_error"]) == (7, 0.5)
    assert "paper_violation" not in row


def test_the_papers_six_columns():
    assert [(problem.id, name) for problem in BENCHMARK for name in summarised(problem)] == [
        ("PendulumSwingup-v0", "moe-custom"),
        ("GroundVehicle-v0", "moe-custom"),
        ("GroundVehicle-v0", "moe-kmeans-6"),
        ("Quadcopter-v0", "moe-kmeans-4"),
        ("QuadcopterObstacle-v0", "moe-custom"),
        ("QuadcopterObstacle-v0", "moe-kmeans-8"),
    ]
    for benchmark in BENCHMARKS.values():
        for name, figures in benchmark.published.items():
            described = [figures.cluster_sizes, figures.gate_accuracy, figures.expert_test_error]
            assert len({value is None for value in described}) == 1, name
            assert np.isfinite([v for v in dataclasses.astuple(figures) if isinstance(v, float)]).all()
