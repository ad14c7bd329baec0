"""The table of models; the summary, from the committed records."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from moe_policy.experiments.benchmark import BENCHMARKS, benchmark_of
from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.paper_tables import TRAINING_COLUMNS, Source, SummaryTable, summarised, summary
from moe_policy.experiments.seeds import TrainingComparison, TrainingRow
from moe_policy.reports.records import ABSENT, read
from moe_policy.reports.tables import DASH, markdown_table
from ocp_envs.problems import BENCHMARK
from ocp_envs.sets import reference
from tests.experiments.test_seeds import model

RESULTS = Path(__file__).resolve().parents[2] / "results"


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
        for name, values in benchmark.published.items():
            described = [values.cluster_sizes, values.gate_accuracy, values.expert_test_error]
            assert len({value is None for value in described}) == 1, name
            assert np.isfinite([v for v in dataclasses.astuple(values) if isinstance(v, float)]).all()


def test_the_committed_summary_follows_from_the_committed_trainings():
    """But for what older records lack: there the gate and the experts are those of the shipped mixture."""
    problem = next(problem for problem in BENCHMARK if problem.id == "QuadcopterObstacle-v0")
    trained = read(RESULTS / f"compare_training_{problem.id}.json", TrainingComparison)
    columns, rows = summary([Source(problem, trained.rows, len(reference.load(problem, "validation")))])
    assert [column.title for column in columns] == [f"{problem.id}, moe-custom", f"{problem.id}, moe-kmeans-8"]
    committed = {row.label: row.cells for row in read(RESULTS / "table_summary.json", SummaryTable).rows}
    for row in rows:
        assert row.cells == {column.key: committed[row.label][column.key] for column in columns}, row.label


def test_a_record_without_clusters_has_no_column():
    problem = BENCHMARK[0]
    rows = [TrainingRow.of(name, [model(0)], benchmark_of(problem).published[name]) for name in ("snn", "moe-custom")]
    with pytest.raises(ValueError, match="expected a value of a mixture"):
        summary([Source(problem, [rows[0], dataclasses.replace(rows[1], cluster_sizes=ABSENT)], 10)])


def test_the_table_of_models():
    row = TrainingRow.of("moe-custom", [model(0, 985), model(1, 990), model(2, 999)], Published(success=998))
    violated = TrainingRow.of("snn", [model(0, 990, violation=0.2)], Published(violation=0.3))
    head, _, first, second = markdown_table([row, violated], TRAINING_COLUMNS).splitlines()
    assert head.startswith("| model | training problems | success at the plan's end, median (range) | … after")
    cells = ["moe-custom", "20", "495 (492–499)", "990 (985–999)", "998", *[DASH] * 3, "0.020", "0.0100"]
    assert first == f"| {' | '.join(cells)} |"
    cells = ["snn", "20", "495 (495–495)", "990 (990–990)", DASH, "0.200", "0.200", "0.300", "0.020", "0.0100"]
    assert second == f"| {' | '.join(cells)} |"
