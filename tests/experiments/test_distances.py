"""Bins and curves over the distance from the discontinuity, against counts by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from moe_policy.experiments.distances import DistanceCurves, log_bins, measures_of
from moe_policy.reports.metric_columns import METRICS
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from tests.rollouts.test_metrics import episodes


@given(
    hnp.arrays(np.float64, st.integers(1, 200), elements=st.floats(1e-8, 1e3)),
    st.integers(1, 6),
    st.integers(1, 40),
)
def test_bins_hold_all_and_enough(distances, per_decade, minimum):
    edges = log_bins(distances, per_decade, minimum)
    assert (np.diff(edges) > 0).all()
    assert edges[0] <= distances.min()
    assert distances.max() <= edges[-1]
    counts = np.histogram(distances, edges)[0]
    assert counts.sum() == len(distances)
    assert len(counts) == 1 or counts.min() >= minimum
    # Edges lie on the grid of equal ratios.
    np.testing.assert_allclose(np.log10(edges) * per_decade, np.round(np.log10(edges) * per_decade), atol=1e-6)


@pytest.mark.parametrize("distances", [[], [1.0, 0.0], [1.0, np.inf]])
def test_what_cannot_be_binned_is_refused(distances):
    with pytest.raises(ValueError, match="positive and finite"):
        log_bins(np.array(distances))


def test_curves_count_successes_by_distance():
    """Forty instances near the discontinuity, of which a planner solves a quarter; forty far from it, all solved."""
    distances = np.concatenate([np.full(40, 1e-3), np.full(40, 0.5), [np.inf]])
    close = np.repeat([True, False, False], [10, 30, 41])
    far = distances > 0.1
    planner = episodes(81, success=close | far, plan_end_error=np.where(far, 0.01, 1.0))
    learner = episodes(81, success=far)
    found = DistanceCurves.of(PENDULUM, distances, {"snn": planner, "sac": learner})
    assert DistanceCurves.from_json(found.to_json()) == found
    assert found.problems == (40, 40)
    np.testing.assert_allclose(found.distance, [1e-3, 0.5])
    assert found.distance_unknown == 1
    assert found.metrics == {
        "success_at_plan_end": {"snn": (Proportion(0, 40), Proportion(40, 40))},
        "success": {
            "snn": (Proportion(10, 40), Proportion(40, 40)),
            "sac": (Proportion(0, 40), Proportion(40, 40)),
        },
    }


def test_curves_of_further_methods_are_added():
    distances, few = np.full(50, 0.1), {"success": np.arange(50) < 30}
    first, second = (
        DistanceCurves.of(PENDULUM, distances, {name: episodes(50, **few) for name in names})
        for names in (("sac",), ("ppo", "stabiliser"))
    )
    both = first.with_methods(second, ["ppo"])
    assert list(both.metrics["success"]) == ["sac", "ppo"]
    assert both.metrics["success"]["ppo"] == second.metrics["success"]["ppo"]


def test_curves_round_an_obstacle_are_of_violations():
    deep = np.repeat([0.4, 0.1], 30)
    run = episodes(60, violation=deep, knot_violation=deep / 2, plan_end_error=np.zeros(60))
    found = DistanceCurves.of(QUADCOPTER_OBSTACLE, np.repeat([0.02, 0.7], 30), {"snn": run})
    assert DistanceCurves.from_json(found.to_json()) == found
    assert [entry.mean for entry in found.metrics["violation_mean"]["snn"]] == pytest.approx([0.4, 0.1])
    assert [entry.count for entry in found.metrics["success_clear_0.05"]["snn"]] == [0, 0]


def test_measures_are_metrics_of_a_comparison():
    known = {metric.key for metric in METRICS}
    assert all(m.name in known for problem in (PENDULUM, VEHICLE, QUADCOPTER_OBSTACLE) for m in measures_of(problem))
    assert [measure.name for measure in measures_of(VEHICLE)] == ["success"]  # evaluated at the plan's end: no hold
