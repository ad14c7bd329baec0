"""Separations, cost differences and the table of the splits, against counts by hand."""

import numpy as np
import pytest

from moe_policy.experiments.comparison import ComparisonRow
from moe_policy.experiments.splits import (
    CostDifferenceRange,
    SeedsRow,
    Separation,
    SplitComparison,
    SplitMethod,
    SplitRow,
    SplitSummary,
    separations,
    uniform_row,
)
from moe_policy.experiments.trainings import Run
from moe_policy.learning.settings import TrainingSettings
from moe_policy.reports.split_table import SPLIT_COLUMNS, Line
from moe_policy.reports.tables import markdown_table
from moe_policy.rollouts.intervals import Proportion, Spread
from moe_policy.rollouts.metrics import evaluate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.support.provenance import provenance
from tests.rollouts.test_metrics import episodes


def a_row(problem, name, run):
    row = ComparisonRow(
        name=name,
        data=None,
        training_seconds=None,
        metrics=evaluate(problem, run),
        parameters_total=None,
        parameters_active=None,
    )
    return SplitRow.of(problem, row, run)


def test_separations_are_between_the_single_network_and_mixtures():
    few, many, nearly = (np.arange(500) < count for count in (100, 490, 480))
    ends = {True: 0.01, False: 1.0}
    runs = {
        "snn": episodes(500, success=few, plan_end_error=[ends[bool(there)] for there in nearly]),
        "moe-custom": episodes(500, success=many, plan_end_error=[ends[bool(there)] for there in many]),
        "sac": episodes(500, success=many),
    }
    rows = {name: a_row(PENDULUM, name, run) for name, run in runs.items()}
    assert rows["sac"].judged == {"success": Proportion(490, 500), "success_at_plan_end": None}
    assert separations(PENDULUM, rows) == (
        Separation(metric="success_at_plan_end", mixture="moe-custom", disjoint=False),
        Separation(metric="success", mixture="moe-custom", disjoint=True),
    )
    assert separations(PENDULUM, {"sac": rows["sac"]}) == ()


def test_separations_of_means_are_those_of_their_intervals():
    spread = np.linspace(-0.05, 0.05, 30)
    runs = {
        name: episodes(30, violation=mean + spread, knot_violation=0.2 + spread, plan_end_error=np.zeros(30))
        for name, mean in (("snn", 0.5), ("moe-custom", 0.1))
    }
    rows = {name: a_row(QUADCOPTER_OBSTACLE, name, run) for name, run in runs.items()}
    found = {entry.metric: entry.disjoint for entry in separations(QUADCOPTER_OBSTACLE, rows)}
    assert found == {"success_clear_0.01": False, "success_clear_0.05": False, "violation_mean": True}


def test_the_table_has_a_column_for_each_metric_that_is_there():
    metrics = evaluate(PENDULUM, episodes(4, success=[True, True, True, False]))
    spreads = {"success": Spread.of([478, 400, 461])}
    rows = [Line("uniform", "sac", metrics), Line("", "snn, 3 seeds", spreads=spreads)]
    head, _, *lines = markdown_table(rows, SPLIT_COLUMNS).splitlines()
    assert head == "| split | policy | … after terminal regulation |"
    assert lines == ["| uniform | sac | 3 (30.1–95.4 %) |", "|  | snn, 3 seeds | 461 (400–478) |"]


def test_seeds_of_a_network_have_a_spread_of_every_metric_that_all_have():
    settings = TrainingSettings(epochs=7)
    runs = [Run("snn", seed, 40, settings) for seed in (0, 1)]
    found = [evaluate(PENDULUM, episodes(4, success=np.arange(4) < count)) for count in (1, 3)]
    row = SeedsRow.of(runs, {"uniform": found})
    assert (row.samples, row.epochs, row.seeds, row.cases) == (40, 7, (0, 1), {"uniform": 4})
    assert row.label("uniform") == "snn, 2 seeds, of 4"
    assert set(row.splits["uniform"]) == {"success"}
    assert row.splits["uniform"]["success"].values == (1, 3)


def a_record(names, cases=500, seed=0):
    """A comparison of ``names`` on one split, every one with other successes by the ``seed``."""
    runs = {name: episodes(500, success=np.arange(500) < 400 + i + seed) for i, name in enumerate(names)}
    rows = {name: a_row(PENDULUM, name, run) for name, run in runs.items()}
    nothing = CostDifferenceRange(within=cases, largest=0.0, smallest=0.0)
    summary = SplitSummary(cases=cases, optimal_solved=cases, reference_difference=nothing, separations=())
    return SplitComparison(
        env_id=PENDULUM.id,
        splits={"uniform": summary},
        rows=tuple(SplitMethod(name=name, splits={"uniform": row}) for name, row in rows.items()),
        curves=None,
        seconds=1.0,
        provenance=provenance(),
    )


def test_rows_of_further_methods_are_added_to_a_record_and_replace_those_of_their_names():
    old, new = a_record(["snn", "moe-auto", "sac"]), a_record(["optimal", "moe-auto"], seed=50)
    both = old.with_rows(new, ["moe-auto"])
    assert [row.name for row in both.rows] == ["snn", "sac", "moe-auto"]
    assert both.rows[0] == old.rows[0]
    assert uniform_row(both, "moe-auto", 500).metrics.success.count == 451
    assert {entry.mixture for entry in both.splits["uniform"].separations} == {"moe-auto"}
    assert both.added == {"moe-auto": new.provenance}
    assert SplitComparison.from_json(both.to_json()) == both


def test_rows_of_other_instances_are_not_added():
    with pytest.raises(ValueError, match=r"rows cannot be added: .*'uniform': 500.*'uniform': 30"):
        a_record(["snn"]).with_rows(a_record(["moe-auto"], cases=30), ["moe-auto"])


def test_a_row_of_other_instances_or_of_no_method_is_none():
    record = a_record(["snn"])
    assert uniform_row(record, "snn", 500) is record.rows[0].splits["uniform"].row
    assert uniform_row(record, "snn", 30) is None
    assert uniform_row(record, "moe-auto", 500) is None


def test_cost_differences_range_from_0_at_most_to_0_at_least():
    found = CostDifferenceRange.of(np.array([1.0, 2.2, 3.0005]), np.array([1.0, 2.0, 3.0]))
    assert (found.within, found.smallest) == (2, 0.0)
    np.testing.assert_allclose(found.largest, 0.1)
