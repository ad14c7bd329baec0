import dataclasses

import numpy as np
import pytest

from moe_policy.checking.forecast import Predicted
from moe_policy.checking.selection import Selected, better, cheapest, deficit
from moe_policy.checking.verdict import reason_of
from ocp_envs.trajectory import Trajectory
from tests.small_problems import WALLED_INTEGRATOR

RADIUS = 0.05


def predicted(*rows):
    """Forecasts of (cost, final_error, clearance, left_box, rejected)."""
    cost, error, clearance, left, rejected = (np.array(column) for column in zip(*rows))
    success = (error < RADIUS) & (clearance > 0) & ~left & ~rejected
    return Predicted(
        cost.astype(float), error.astype(float), clearance.astype(float), left, rejected, success, cost.astype(float)
    )


DEAR, CHEAP = (5.0, 0.0, 1.0, False, False), (3.0, 0.01, 1.0, False, False)
NEAR, FAR = (1.0, 0.06, 1.0, False, False), (1.0, 0.5, 1.0, False, False)
DEEP, SHALLOW = (1.0, 0.0, -0.5, False, False), (1.0, 0.0, -0.01, False, False)
OUTSIDE, REJECTED = (1.0, 0.0, 1.0, True, False), (1.0, np.nan, 1.0, False, True)
RANKED = (CHEAP, DEAR, SHALLOW, NEAR, DEEP, FAR, OUTSIDE, REJECTED)


@pytest.mark.parametrize("first", range(len(RANKED) - 1))
def test_the_cheapest_success_is_the_best_and_failures_rank_by_their_distance_from_it(first):
    one, other = predicted(RANKED[first]), predicted(RANKED[first + 1])
    assert better(one, other, RADIUS).tolist() == [True]
    assert better(other, one, RADIUS).tolist() == [False]
    both = predicted(RANKED[first + 1], RANKED[first])
    assert cheapest(both, np.zeros(2, int), RADIUS).tolist() == [1]


def test_the_best_is_found_for_each_instance():
    rows = np.array([0, 1, 3, 0, 1, 3])
    plans = predicted(DEAR, FAR, REJECTED, CHEAP, NEAR, REJECTED)
    assert cheapest(plans, rows, RADIUS).tolist() == [3, 4, 2]
    assert deficit(plans, RADIUS)[[0, 2]].tolist() == [0.0, np.inf]


def test_only_better_plans_replace_others():
    def selected(forecasts, how):
        size = len(forecasts.cost)
        plan = Trajectory(np.full((size, 2, 1), how), np.zeros((size, 1, 1)), np.full(size, 1.0))
        return Selected(plan, forecasts, np.full(size, how), np.full(size, how))

    old = selected(predicted(DEAR, FAR, CHEAP, FAR), 0)
    new = selected(predicted(NEAR, CHEAP, DEAR), 1)
    mixed = old.improved(np.array([3, 0, 2]), new, RADIUS)
    assert mixed.how.tolist() == [1, 0, 0, 1]
    assert mixed.predicted.cost.tolist() == [CHEAP[0], FAR[0], CHEAP[0], NEAR[0]]
    np.testing.assert_array_equal(mixed.plan.states[:, 0, 0], mixed.how)


def test_reasons_say_what_fails():
    reasons = [reason_of(WALLED_INTEGRATOR, predicted(row)) for row in (CHEAP, SHALLOW, NEAR, OUTSIDE, REJECTED)]
    assert reasons == [
        "",
        "the path enters a constraint by 0.01",
        "the plan ends 0.06 from the goal, whose radius is 0.05",
        "the state leaves its operating box",
        "there is no plan that is finite",
    ]
    drifting = dataclasses.replace(predicted(CHEAP), success=np.array([False]), clearance=np.array([np.inf]))
    assert reason_of(WALLED_INTEGRATOR, drifting) == "terminal regulation does not keep the state at the goal"
    both = (1.0, 0.5, -0.5, False, False)
    assert reason_of(WALLED_INTEGRATOR, predicted(both)).count(" and ") == 1
    touching = predicted((1.0, 0.0, 0.0, False, False))
    assert reason_of(WALLED_INTEGRATOR, touching) == "the path comes as close to a constraint as 0"
