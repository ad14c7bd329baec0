"""Bins, curves and separations against counts by hand and SciPy's interval."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from moe_policy.experiments.splits import (
    SPLIT_COLUMNS,
    curves,
    disjoint,
    judged,
    log_bins,
    metrics_of,
    separations,
)
from moe_policy.experiments.tables import markdown_table
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import evaluate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from tests.rollouts.test_metrics import episodes


@given(
    hnp.arrays(np.float64, st.integers(1, 200), elements=st.floats(1e-8, 1e3)),
    st.integers(1, 6),
    st.integers(1, 40),
)
def test_bins_hold_all_and_enough(distances, per_decade, least):
    edges = log_bins(distances, per_decade, least)
    assert (np.diff(edges) > 0).all()
    assert edges[0] <= distances.min()
    assert distances.max() <= edges[-1]
    counts = np.histogram(distances, edges)[0]
    assert counts.sum() == len(distances)
    assert len(counts) == 1 or counts.min() >= least
    # Edges lie on the grid of equal ratios.
    np.testing.assert_allclose(np.log10(edges) * per_decade, np.round(np.log10(edges) * per_decade), atol=1e-6)


@pytest.mark.parametrize("distances", [[], [1.0, 0.0], [1.0, np.inf]])
def test_what_cannot_be_binned_is_refused(distances):
    with pytest.raises(ValueError, match="positive and finite"):
        log_bins(np.array(distances))


def test_curves_count_successes_by_distance():
    """Forty problems close to the jump, of which a planner solves a quarter; forty far from it, all solved."""
    distances = np.concatenate([np.full(40, 1e-3), np.full(40, 0.5), [np.inf]])
    close = np.repeat([True, False, False], [10, 30, 41])
    far = distances > 0.1
    planner = episodes(81, success=close | far, plan_end_error=np.where(far, 0.01, 1.0))
    learner = episodes(81, success=far)
    found = curves(PENDULUM, distances, {"snn": planner, "sac": learner})
    assert json.loads(json.dumps({**found, "edges": found["edges"].tolist()}))
    assert found["problems"] == [40, 40]
    np.testing.assert_allclose(found["distance"], [1e-3, 0.5])
    assert found["distance_unknown"] == 1
    assert set(found["metrics"]) == {"success_at_plan_end", "success"}
    shares = found["metrics"]["success"]
    assert shares["snn"] == [Proportion(10, 40).to_json(), Proportion(40, 40).to_json()]
    assert shares["sac"] == [Proportion(0, 40).to_json(), Proportion(40, 40).to_json()]
    assert found["metrics"]["success_at_plan_end"] == {
        "snn": [Proportion(0, 40).to_json(), Proportion(40, 40).to_json()]
    }


def test_curves_round_an_obstacle_are_of_violations():
    deep = np.repeat([0.4, 0.1], 30)
    run = episodes(60, violation=deep, knot_violation=deep / 2, plan_end_error=np.zeros(60))
    found = curves(QUADCOPTER_OBSTACLE, np.repeat([0.02, 0.7], 30), {"snn": run})["metrics"]
    assert [entry["mean"] for entry in found["violation_mean"]["snn"]] == pytest.approx([0.4, 0.1])
    assert [entry["mean"] for entry in found["knot_violation_mean"]["snn"]] == pytest.approx([0.2, 0.05])


def test_metrics_are_those_of_the_rows():
    row = vars(evaluate(VEHICLE, episodes()))
    for problem in (PENDULUM, VEHICLE, QUADCOPTER_OBSTACLE):
        assert set(metrics_of(problem)) <= set(row)
    assert list(metrics_of(VEHICLE)) == ["success"]  # judged at the plan's end: there is no hold


def test_intervals_that_touch_are_not_disjoint():
    def interval(low, high):
        return {"interval": [low, high]}

    assert disjoint(interval(0.1, 0.2), interval(0.3, 0.4))
    assert disjoint(interval(0.3, 0.4), interval(0.1, 0.2))
    assert not disjoint(interval(0.1, 0.3), interval(0.3, 0.4))
    assert not disjoint(interval(0.1, 0.9), interval(0.3, 0.4))


def test_separations_are_between_the_single_network_and_mixtures():
    few, many, nearly = (np.arange(500) < count for count in (100, 490, 480))
    ends = {True: 0.01, False: 1.0}
    rows = {
        "snn": episodes(500, success=few, plan_end_error=[ends[bool(there)] for there in nearly]),
        "moe-custom": episodes(500, success=many, plan_end_error=[ends[bool(there)] for there in many]),
        "sac": episodes(500, success=many),
    }
    rows = {name: {"judged": judged(PENDULUM, run)} for name, run in rows.items()}
    assert rows["sac"]["judged"] == {"success": Proportion(490, 500).to_json(), "success_at_plan_end": None}
    assert separations(PENDULUM, rows) == [
        {"metric": "success_at_plan_end", "mixture": "moe-custom", "disjoint": False},
        {"metric": "success", "mixture": "moe-custom", "disjoint": True},
    ]
    assert separations(PENDULUM, {"sac": rows["sac"]}) == []


def test_separations_of_means_are_those_of_their_intervals():
    spread = np.linspace(-0.05, 0.05, 30)
    runs = {
        name: episodes(30, violation=mean + spread, knot_violation=0.2 + spread, plan_end_error=np.zeros(30))
        for name, mean in (("snn", 0.5), ("moe-custom", 0.1))
    }
    rows = {name: {"judged": judged(QUADCOPTER_OBSTACLE, run)} for name, run in runs.items()}
    assert [entry["disjoint"] for entry in separations(QUADCOPTER_OBSTACLE, rows)] == [False, True]


def test_the_table_has_a_column_for_each_split_and_figure_that_is_there():
    row = {"success": evaluate(PENDULUM, episodes(4, success=[True, True, True, False])).success.to_json()}
    text = markdown_table([{"name": "sac", "uniform": row, "outside": row}], SPLIT_COLUMNS)
    head, _, line = text.splitlines()
    assert head == "| policy | uniform: success | outside: success |"
    assert line.count("3 (30.1–95.4 %) of 4") == 2
