"""The choice of the number of clusters, from made-up models."""

import pytest

from moe_policy.experiments.cluster_choice import CLUSTER_COLUMNS, ClusterRow, chosen, noted
from moe_policy.experiments.cluster_models import ClusterModel
from moe_policy.reports.records import ABSENT
from moe_policy.reports.tables import markdown_table


def row(k, *counts, clear=ABSENT):
    """The row of ``k`` with mixtures that are at the goal ``counts`` times at the plan's end, one for each seed."""
    models = [
        ClusterModel(
            k=k,
            seed=seed,
            at_plan_end=count,
            success=1000,
            clear_5_cm=clear,
            clear_1_cm=clear,
            relative_cost=1.01,
            gate_accuracy=0.9,
            test_error=0.01,
            training_seconds=2.0,
            parameters_total=100 * k,
            parameters_active=120,
        )
        for seed, count in enumerate(counts)
    ]
    return ClusterRow.of(models)


def test_the_smallest_number_within_the_interval_of_the_best_is_chosen():
    rows = [row(2, 700, 980, 650), row(4, 981, 985, 970), row(6, 990, 991, 985), row(10, 991, 960, 992)]
    k, (low, high) = chosen(rows, 1000)
    assert k == 6  # 981 is below the interval of 991, and 990 in it
    assert (low, high) == pytest.approx((983.0, 995.2), abs=0.5)
    assert chosen(rows[::-1], 1000)[0] == 6


def test_a_best_number_that_is_alone_is_chosen():
    assert chosen([row(2, 500), row(4, 900), row(6, 700)], 1000)[0] == 4


def test_with_path_constraints_clear_rollouts_count():
    rows = [row(2, 990, clear=400), row(4, 950, clear=600)]
    assert chosen(rows, 1000)[0] == 4
    assert rows[0].measure == 400
    assert "clear" not in markdown_table([row(2, 990)], CLUSTER_COLUMNS)
    assert "| 400 (400–400) |" in markdown_table(rows, CLUSTER_COLUMNS)


def test_rows_tell_which_number_is_chosen_and_which_is_used():
    rows = noted([row(6, 990), row(2, 700), row(4, 991)], 4, 6)
    assert [(r.k, r.note) for r in rows] == [(2, ""), (4, "chosen"), (6, "used")]
    assert [r.note for r in noted(rows, 6, 6)] == ["", "", "chosen, used"]


def test_the_median_over_seeds_is_compared():
    rows = [row(2, 980, 900, 985), row(4, 989, 700, 700)]
    assert rows[1].at_plan_end.median == 700
    assert chosen(rows, 1000)[0] == 2


def test_rows_survive_the_round_trip():
    made = noted([row(2, 990, 980), row(4, 950, 940, clear=600)], 2, 4)
    for r in made:
        assert ClusterRow.from_json(r.to_json()) == r
