"""The overview, from committed records and from made-up ones."""

from pathlib import Path

import pytest

from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.benchmark.parts import Overview
from moe_policy.experiments.checking import checked_row
from moe_policy.experiments.comparison import Comparison, ComparisonRow, CostDifference
from moe_policy.experiments.learners import learner_trainings
from moe_policy.experiments.overview import FOUND, OverviewTable, Sources, overview_rows
from moe_policy.experiments.seeds import TrainingComparison
from moe_policy.experiments.splits import SplitComparison, uniform_row
from moe_policy.reports.records import present, read
from moe_policy.rollouts.intervals import Mean, Proportion
from moe_policy.rollouts.metrics import CostRatio, Metrics, Violation
from ocp_envs.problems import PAPER
from ocp_envs.support.provenance import provenance

RESULTS = Path(__file__).resolve().parents[2] / "results"


def row(name, count, at_end, ratio=1.0, violation=None):
    metrics = Metrics(
        reached=Proportion(count, 10),
        success=Proportion(count, 10),
        success_at_plan_end=None if at_end is None else Proportion(at_end, 10),
        plan_end_error_median=None,
        plan_end_error_95=None,
        final_error_median=0.0,
        final_error_95=0.0,
        cost_ratio=CostRatio(ratio, 10),
        left_box=0,
        clipped=0,
        rejected=0,
        success_clear=None if violation is None else {"0.01": Proportion(4, 10), "0.05": Proportion(6, 10)},
        violation=None if violation is None else Violation(Mean(violation, 10, (0.0, 0.1)), 0.2, 0.3),
        knot_violation=None,
    )
    return ComparisonRow(
        name=name, data=None, training_seconds=None, metrics=metrics, parameters_total=None, parameters_active=None
    )


def comparison(*rows):
    return Comparison(
        env_id="X-v0",
        cases=10,
        seed=0,
        reference_difference=CostDifference(within=10, largest=0.0),
        seconds=1.0,
        rows=rows,
        provenance=provenance(),
    )


def sources(problem):
    compared = read(RESULTS / f"compare_{problem.id}.json", Comparison)
    trained = read(RESULTS / f"compare_training_{problem.id}.json", TrainingComparison)
    splits = read(RESULTS / f"compare_splits_{problem.id}.json", SplitComparison)
    checked = checked_row(RESULTS / f"planners_checked_{problem.id}.json", compared.cases)
    others = [row for row in (checked, uniform_row(splits, FOUND, compared.cases)) if row is not None]
    return Sources(compared, trained.rows, learner_trainings(RESULTS, problem), present(splits.seeds) or (), others)


def test_the_committed_overview_follows_from_the_committed_comparisons():
    rows = [row for problem in PAPER for row in overview_rows(sources(problem), benchmark_of(problem).overview)]
    assert rows == list(read(RESULTS / "table_overview.json", OverviewTable).rows)


def test_the_benchmark_chooses_among_alike_methods_however_they_did():
    compared = comparison(
        row("optimal", 10, 10),
        row("moe-kmeans-4", 7, 6, 1.25),
        row("moe-kmeans-10", 9, 5),
        row("sac", 3, None),
        row("ppo", 4, None),
        row("snn, radius + 0.1", 10, 10),
    )
    table = overview_rows(Sources(compared), Overview(learner="sac", kmeans="moe-kmeans-4"))
    assert [row.measure for row in table] == [
        "success at the plan's end, of 10",
        "… after terminal regulation",
        "cost / optimal",
    ]
    assert [row.env_id for row in table] == ["X-v0", "", ""]
    assert [row.cells["MoE, k-means"] for row in table] == ["6", "7", "1.250"]
    assert [row.cells["RL"] for row in table] == [None, "3 (sac)", "1.000"]
    assert "SNN" not in table[0].cells
    assert "RL" not in overview_rows(Sources(compared), Overview())[1].cells
    with_checked = overview_rows(Sources(compared, others=[row("checked", 10, 9, 1.5)]), Overview())
    assert [one.cells["MoE, checked"] for one in with_checked] == ["9", "10", "1.500"]


@pytest.mark.parametrize("violation", [None, 0.0625])
def test_the_overview_shows_what_a_problem_has(violation):
    compared = comparison(row("optimal", 10, 10, violation=violation), row("snn", 8, 8, violation=violation))
    measures = [row.measure for row in overview_rows(Sources(compared), Overview())]
    expected = ["success of 10", "cost / optimal"]  # before and after terminal regulation are the same
    clear = [f"at the goal, within {d} cm of the constraint, of 10" for d in (1, 5)]
    assert measures == (expected if violation is None else [*clear, "mean violation on the whole path, m", *expected])
