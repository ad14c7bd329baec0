"""Separations, cost differences and the table of the splits, against counts by hand."""

import numpy as np

from moe_policy.experiments.comparison import ComparisonRow
from moe_policy.experiments.splits import (
    SPLIT_COLUMNS,
    CostDifferenceRange,
    Separation,
    SplitMethod,
    SplitRow,
    separations,
)
from moe_policy.experiments.tables import markdown_table
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import evaluate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
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
    assert [entry.disjoint for entry in separations(QUADCOPTER_OBSTACLE, rows)] == [False, True]


def test_the_table_has_a_column_for_each_split_and_metric_that_is_there():
    row = a_row(PENDULUM, "sac", episodes(4, success=[True, True, True, False]))
    text = markdown_table([SplitMethod(name="sac", splits={"uniform": row, "outside": row})], SPLIT_COLUMNS)
    head, _, line = text.splitlines()
    assert head == "| policy | uniform: success | outside: success |"
    assert line.count("3 (30.1–95.4 %) of 4") == 2


def test_cost_differences_range_from_0_at_most_to_0_at_least():
    found = CostDifferenceRange.of(np.array([1.0, 2.2, 3.0005]), np.array([1.0, 2.0, 3.0]))
    assert (found.within, found.smallest) == (2, 0.0)
    np.testing.assert_allclose(found.largest, 0.1)
