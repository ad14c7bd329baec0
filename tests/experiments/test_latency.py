"""Timed planners, ways of starting the solver and timed steps, on the pendulum; and the script that runs them."""

import importlib
import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.latency import (
    PLANNING_COLUMNS,
    Latency,
    PlanRow,
    StepRow,
    planner_rows,
    planning_rows,
    step_rows,
    time_planner,
)
from moe_policy.experiments.speed.guesses import cold, solver_rows, warm
from moe_policy.reports.tables import markdown_table
from moe_policy.score.method import Method
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import provenance
from tests.in_process import Solver

P = np.array([[0.5, 0.0], [2.0, 1.0], [4.0, -0.5]])


@pytest.fixture(scope="module")
def optima():
    return [ocp_envs.solve(PENDULUM, row, starts=4) for row in P]


def test_planners_are_timed_beside_each_other_and_per_plan():
    sizes = []

    def slow(p):
        sizes.append(len(p))
        time.sleep(0.02)

    def quick(p):
        time.sleep(0.002)

    first, second = planner_rows({"slow": slow, "quick": quick}, P, batches=(1, 5), turns=3, calls=2)
    assert sizes == [2, *[1, 1, 5] * 3]
    assert (first.name, first.ratio) == ("slow", {"1": 1.0, "5": 1.0})
    assert first.seconds["1"] >= 0.02
    assert first.seconds["5"] >= 0.02 / 5
    for batch in ("1", "5"):
        assert second.ratio[batch] == pytest.approx(first.seconds[batch] / second.seconds[batch])
    assert second.ratio["1"] > 1


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
        rows = {row.name: row for row in solver_rows(solver, starts, P, best)}
    assert (rows["cold"].solves, rows["warm"].solves) == (9, 3)
    assert rows["warm"].verified == rows["warm"].best_known == 3
    assert rows["warm"].iterations_median <= rows["cold"].iterations_median
    assert all(row.seconds_per_problem > 0 for row in rows.values())
    times = [rows[name].seconds_per_problem for name in ("cold", "warm")]
    assert (rows["cold"].ratio, rows["warm"].ratio) == (1.0, times[0] / times[1])


def test_a_wrong_best_cost_is_not_reached(optima):
    best = np.array([solution.cost for solution in optima])
    with GuardedSolver(PENDULUM) as solver:
        (row,) = solver_rows(solver, {"line": cold(PENDULUM, "line")}, P, best / 2)
    assert row.best_known == 0


def test_hung_solves_are_counted_where_they_happen():
    class Hanging:
        """A solver that says it hung on every guess longer than 7 s; lines are shorter."""

        restarts = 0

        def __init__(self):
            self.inner = Solver(PENDULUM)

        def solve(self, parameters, guesses, windings, *, retry_with_fallback):
            self.restarts += int((guesses.duration > 7).sum())
            return self.inner.solve(parameters, guesses, windings, retry_with_fallback=retry_with_fallback)

    def long(p):
        rows, guess, windings = cold(PENDULUM, "line")(p)
        return rows, ocp_envs.Trajectory(guess.states, guess.controls, np.full(len(rows), 7.5)), windings

    first, second, third = solver_rows(
        Hanging(),
        {"line": cold(PENDULUM, "line"), "long": long, "again": cold(PENDULUM, "line")},
        P,
        np.ones(3),
    )
    assert (first.hung, second.hung, third.hung) == (0, second.solves, 0)


def test_what_no_solve_converges_on_has_no_figures(optima):
    def nowhere(p):
        bad = ocp_envs.Trajectory.concatenate([optima[0].trajectory] * len(p))
        return np.arange(len(p)), bad, np.zeros(len(p), np.int64)

    settings = SolverSettings(max_iterations=1)
    with GuardedSolver(PENDULUM, settings) as solver:
        (row,) = solver_rows(solver, {"nowhere": nowhere}, P[1:], np.ones(2))
    assert (row.verified, row.solved_problems, row.best_known) == (0, 0, 0)
    assert row.iterations_median is row.milliseconds_median is None


def test_steps_of_planners_and_of_policies_are_timed():
    def planner(p):
        time.sleep(0.02)
        return moe_policy.load(PENDULUM.id, "moe-custom")(p)

    everyone = [Method("moe", planner), Method("stabiliser", moe_policy.Stabiliser(PENDULUM))]
    moe, stabiliser = step_rows(PENDULUM, everyone, P, steps=5)
    assert (moe.name, stabiliser.name) == ("moe", "stabiliser")
    assert moe.plan_seconds >= 0.02
    assert moe.regulators_seconds > moe.step_seconds  # they are set up for every step of the plan at once
    assert stabiliser.plan_seconds is stabiliser.regulators_seconds is None
    for row in (moe, stabiliser):
        assert row.step_seconds > 0
        assert row.step_share_of_period == pytest.approx(row.step_seconds / 0.02)


def test_the_ratio_with_regulators_adds_them_to_both_planners():
    step = StepRow(name="snn", plan_seconds=5.0, regulators_seconds=3.0, step_seconds=1e-4, step_share_of_period=0.005)
    plans = [PlanRow(name=name, seconds={"1": s}, ratio={"1": 9 / s}) for name, s in (("optimal", 9.0), ("snn", 1.0))]
    record = Latency(
        env_id=PENDULUM.id, cases=1, dt=0.02, planners=tuple(plans), solver=(), steps=(step,), provenance=provenance()
    )
    optimal, snn = planning_rows(record)
    assert (snn.ready, snn.ratio_ready) == (4.0, 3.0)
    assert optimal.ready is optimal.ratio_ready is None
    assert "| snn | 1 s | 9 | 3 s | 4 s | 3 |" in markdown_table([optimal, snn], PLANNING_COLUMNS)


@pytest.mark.skipif("moe-custom" not in moe_policy.available(PENDULUM.id), reason="needs the shipped models")
def test_the_script_times_every_planner(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: None, raising=False)
    module = importlib.import_module("benchmark_planning")
    monkeypatch.setattr(module, "BATCHES", (1, 3))
    arguments = ["--env", PENDULUM.id, "--cases", "3", "--episodes", "1", "--results", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["benchmark_planning", *arguments])
    module.main()
    record = json.loads((tmp_path / f"benchmark_planning_{PENDULUM.id}.json").read_text())
    planners = ["nearest", *benchmark_of(PENDULUM).planners.compared]
    solved = [f"{name}, one solve" for name in planners if name != "nearest"]
    assert [row["name"] for row in record["planners"]] == ["optimal", *planners, *solved]
    assert [row["name"] for row in record["solver"]] == [
        "cold, random",
        "cold, line",
        *(f"warm, {name}" for name in planners),
    ]
    assert {"optimal", *planners, *solved, "stabiliser"} <= {row["name"] for row in record["steps"]}
    assert all(ratio > 0 for row in record["planners"] for ratio in row["ratio"].values())
    assert all(row["ratio"] > 0 for row in record["solver"])
    assert all(row["step_seconds"] > 0 for row in record["steps"])


def test_planning_is_timed_per_plan():
    sizes = []

    def planner(p):
        sizes.append(len(p))

    seconds = time_planner(planner, np.zeros((7, 2)), (1, 1000), repeats=3)
    assert sizes == [1] * 4 + [1000] * 4
    assert set(seconds) == {"1", "1000"}
    assert 0 < seconds["1000"] < seconds["1"]
