"""Ways of starting the solver and timed steps, on the pendulum."""

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.comparison import Contestant
from moe_policy.latency import cold, solver_rows, step_rows, warm
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solver import GuardedSolver

P = np.array([[0.5, 0.0], [2.0, 1.0], [4.0, -0.5]])


@pytest.fixture(scope="module")
def optima():
    return [ocp_envs.solve(PENDULUM, row, starts=4) for row in P]


def test_cold_starts_try_every_winding():
    rows, guess, windings = cold(PENDULUM, "random")(P)
    assert rows.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert windings.tolist() == [0, 1, 2] * 3
    np.testing.assert_allclose(guess.states[:, 0], P[rows])


def test_warm_starts_from_the_optimum_end_there_soon(optima):
    trajectories = ocp_envs.Trajectory.concatenate([solution.trajectory for solution in optima])
    best = np.array([solution.cost for solution in optima])
    rank = {tuple(row): i for i, row in enumerate(P)}
    starts = {
        "cold": cold(PENDULUM, "line"),
        "warm": warm(lambda p: trajectories[np.array([rank[tuple(row)] for row in p])]),
    }
    with GuardedSolver(PENDULUM) as solver:
        rows = {row["name"]: row for row in solver_rows(PENDULUM, solver, starts, P, best)}
    assert (rows["cold"]["solves"], rows["warm"]["solves"]) == (9, 3)
    assert rows["warm"]["verified"] == rows["warm"]["best_known"] == 3
    assert rows["warm"]["iterations_median"] <= rows["cold"]["iterations_median"]
    assert all(row["seconds_per_problem"] > 0 for row in rows.values())


def test_a_wrong_best_cost_is_not_reached(optima):
    best = np.array([solution.cost for solution in optima])
    with GuardedSolver(PENDULUM) as solver:
        (row,) = solver_rows(PENDULUM, solver, {"line": cold(PENDULUM, "line")}, P, best / 2)
    assert row["best_known"] == 0


def test_steps_of_planners_and_of_policies_are_timed():
    planner = moe_policy.load(PENDULUM.id, "moe-custom")
    everyone = [Contestant("moe", planner), Contestant("stabiliser", moe_policy.Stabiliser(PENDULUM))]
    rows = step_rows(PENDULUM, everyone, P, ticks=5)
    assert [row["name"] for row in rows] == ["moe", "stabiliser"]
    for row in rows:
        assert 0 < row["step_seconds"] < 1
        assert row["step_share_of_period"] == pytest.approx(row["step_seconds"] / 0.02)
    assert rows[0]["first_seconds"] > rows[0]["step_seconds"]  # the first one plans
