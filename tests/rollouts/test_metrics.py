"""Metrics against closed forms and counts by hand."""

import numpy as np
import pytest

from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import CostRatio, cost_ratio, evaluate
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR


def episodes(size=4, **values):
    nan, none = np.full(size, np.nan), np.zeros(size, bool)
    defaults = {
        "parameters": np.arange(2.0 * size).reshape(size, 2),
        "reached": ~none,
        "success": ~none,
        "cost": np.ones(size),
        "entry_time": np.ones(size),
        "evaluation_time": np.ones(size),
        "final_error": np.zeros(size),
        "plan_end_error": nan,
        "left_box": none,
        "violation": np.zeros(size),
        "knot_violation": nan,
        "clipped": none,
        "rejected": none,
    }
    return Episodes(**{**defaults, **{k: np.asarray(v) for k, v in values.items()}})


def test_metrics_of_a_planning_policy():
    run = episodes(
        5,
        success=[True, True, False, True, False],
        plan_end_error=[0.01, 0.02, 0.3, 0.04, 5.0],
        final_error=[0.0, 0.0, 1.0, 0.0, 3.0],
        left_box=[False, False, False, False, True],
        clipped=[True, False, False, False, False],
        rejected=[False, False, True, False, False],
    )
    metrics = evaluate(DOUBLE_INTEGRATOR, run)
    assert metrics.success == Proportion(3, 5)
    assert metrics.success_at_plan_end == Proportion(3, 5)
    assert metrics.plan_end_error_median == 0.04
    np.testing.assert_allclose(metrics.plan_end_error_95, 0.3 + 0.8 * 4.7)
    assert (metrics.left_box, metrics.clipped, metrics.rejected) == (1, 1, 1)
    assert (metrics.violation, metrics.knot_violation, metrics.success_clear) == (None, None, None)
    assert metrics.cost_ratio is None


def test_metrics_of_a_policy_without_a_plan_are_absent():
    metrics = evaluate(DOUBLE_INTEGRATOR, episodes())
    assert metrics.success_at_plan_end is None
    assert metrics.plan_end_error_median is None


def test_violations_are_reported_where_there_are_constraints():
    run = episodes(violation=[0.0, 0.1, 0.3, 0.0], knot_violation=[0.0, 0.1, np.nan, 0.2], plan_end_error=[0.0] * 4)
    metrics = evaluate(WALLED_INTEGRATOR, run)
    assert (metrics.violation.mean.mean, metrics.violation.maximum) == pytest.approx((0.1, 0.3))
    assert metrics.violation.quantile_99 == pytest.approx(0.294)
    assert (metrics.knot_violation.mean.mean, metrics.knot_violation.maximum) == pytest.approx((0.1, 0.2))


def test_a_success_is_clear_within_a_tolerance_of_the_constraint_on_the_whole_path():
    run = episodes(violation=[0.0, 0.01, 0.03, 0.0], success=[True, True, True, False])
    assert run.clear().tolist() == [True, False, False, True]
    assert run.clear(0.01).tolist() == [True, True, False, True]
    assert evaluate(WALLED_INTEGRATOR, run).success_clear == {"0.01": Proportion(2, 4), "0.05": Proportion(3, 4)}


def test_costs_are_compared_where_both_reach():
    run = episodes(cost=[2.0, 3.0, 100.0, 5.0], reached=[True, True, False, True])
    baseline = episodes(cost=[1.0, 2.0, 1.0, 100.0], reached=[True, True, True, False])
    assert cost_ratio(run, baseline) == CostRatio(5.0 / 3.0, 2)
    assert evaluate(DOUBLE_INTEGRATOR, run, baseline).cost_ratio == CostRatio(5.0 / 3.0, 2)
    nowhere = episodes(reached=[False] * 4)
    assert cost_ratio(nowhere, baseline) == CostRatio(None, 0)
    with pytest.raises(ValueError, match="same parameters"):
        cost_ratio(run, episodes(parameters=np.zeros((4, 2))))


def test_no_episodes_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        evaluate(DOUBLE_INTEGRATOR, episodes(0))
