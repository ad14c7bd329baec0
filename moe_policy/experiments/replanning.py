"""Plans that are renewed on the way, under pushes and on plants that differ: success, cost, changes of the family."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from moe_policy.control.estimation import Estimated, Estimating
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.disturbed import Condition, conditions, pushes
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.solver import SolverPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.protocols import Policy, Schedule, State
from moe_policy.replanning.renewal import Renewal
from moe_policy.replanning.replanning import Renewed, Replanning
from moe_policy.reports.records import ABSENT, Absent, Record
from moe_policy.reports.tables import Column, proportion
from moe_policy.rollouts.environments import Environments, environments
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import cost_ratio, evaluate
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.provenance import Provenance
from ocp_envs.trajectory import Trajectory


class FromAnyState:
    """The plans of ``planner`` from any state, as guesses: those of the nearest parameters in its box."""

    def __init__(self, planner: NetworkPlanner) -> None:
        self.planner, self.problem = planner, planner.problem.from_any_state

    def __call__(self, p: Array) -> Trajectory:
        """Plans of parameters ``p`` (B, nx + nc)."""
        own, box = self.planner.problem.parameters_of(*self.problem.start(p)), self.planner.problem.parameters
        return self.planner(np.clip(own, box.lower, box.upper))


def restarted_solver(problem: OptimalControlProblem, planner: NetworkPlanner, every: float) -> Replanning:
    """The solver, restarted ``every`` seconds from the rest of the old plan and from the plans of ``planner``.

    Of a mixture these are those of all experts. It changes the family for any saving.
    """
    experts = planner.expert_planners() if hasattr(planner.network, "experts") else (planner,)
    guessers = tuple(FromAnyState(expert) for expert in experts)
    solver = SolverPlanner(problem.from_any_state, guessers=guessers)
    return Replanning(solver, every, Renewal(iterations=None, switch=0.0), problem=problem)


def methods(
    problem: OptimalControlProblem, planner: NetworkPlanner, optimal: StoredPlans, every: float, condition: Condition
) -> dict[str, Policy]:
    """The policies that are compared under ``condition``, by name; plans are renewed ``every`` seconds."""
    margin = 0.03 if problem.n_clearances else 0.0
    replanning = Replanning(planner, every, Renewal(margin=margin))
    found: dict[str, Policy] = {
        "optimal, tracked": TrackingPolicy(problem, optimal),
        f"{planner.name}, tracked": TrackingPolicy(problem, planner),
        f"{planner.name}, replanned": replanning,
    }
    if condition.delay:
        found[f"{planner.name}, replanned, delay predicted"] = Estimated(replanning, delay=condition.delay)
    elif "constants" in condition.arguments:
        found[f"{planner.name}, replanned, offset removed"] = Estimated(replanning, offset=True)
    elif condition.pushed:
        found["solver, restarted"] = restarted_solver(problem, planner, every)
    return found


class Observed:
    """The ``policy``, a :class:`Replanning` or an :class:`Estimated` one, with the last recurrent state in ``last``.

    The attribute ``seconds`` has the duration of each control step in which a plan was due, of all rows together.
    """

    def __init__(self, policy: Any, period: int) -> None:
        self.policy, self.dt, self._period = policy, policy.dt, period
        self.last: Renewed | None = None
        self.seconds: list[float] = []
        self.predict, self.start = policy.predict, policy.start

    def check(self, env: Environments) -> None:
        """Refuse an environment ``env`` for which the policy is not made."""
        self.policy.check(env)

    def schedule(self, state: State) -> Schedule | None:
        """The schedule of the policy's recurrent ``state``."""
        found: Schedule | None = self.policy.schedule(state)
        return found

    def act(self, observations: Array, state: State, begins: Bools) -> tuple[Array, State]:
        """The policy's controls at ``observations`` (B, nx + nc) with its ``state``, where episodes ``begins``."""
        before, began = _renewed(state), time.perf_counter()
        controls, state = self.policy.act(observations, state, begins)
        if (
            before is not None
            and ((before.clock % self._period == 0) & (before.clock * self.dt < before.schedule.plan_end)).any()
        ):
            self.seconds.append(time.perf_counter() - began)
        self.last = _renewed(state)
        return controls, state


def _renewed(state: State) -> Renewed | None:
    inner = state.inner if isinstance(state, Estimating) else state
    return inner if isinstance(inner, Renewed) else None


@dataclass(frozen=True, kw_only=True)
class ReplanningRow(Record):
    """One method on one split under one condition."""

    split: str  # of the initial conditions
    condition: str  # in what the plant differs from the model
    method: str  # its name
    success: Proportion  # in the goal ball at the evaluation time of the last plan
    success_at_plan_end: Proportion | None  # in it at the end of the last plan
    left_box: int  # episodes that left the operating box
    relative_cost: float | None  # to the optimal plan, tracked without a disturbance; where both reach the goal
    violation_mean: float | None  # of the path constraints, in their unit
    flips: int | None  # changes to another solution family on the way, in all episodes; ``None`` without renewals
    renewals: int | None  # new plans, in all episodes


@dataclass(frozen=True, kw_only=True)
class Latency(Record):
    """How long control steps take in which a plan is due, of one episode at a time, in milliseconds."""

    condition: str  # of the episodes
    count: int  # number of such control steps
    median: float
    percentile_99: float
    load: float | Absent | None = ABSENT  # mean number of processes that ran or waited in the last minute of it


@dataclass(frozen=True, kw_only=True)
class ReplanningRecord(Record):
    """All methods of one problem: ``replanning_<env>.json``."""

    env_id: str  # id of the problem
    cases: int  # number of initial conditions of each split
    seed: int  # of the pushes
    dt: float  # control period, seconds
    every: float  # time between renewals, seconds
    push: dict[str, float]  # standard deviations of a push by coordinate, in its unit
    pushes: int  # number of pushes in an episode
    rows: tuple[ReplanningRow, ...]
    latency: tuple[Latency, ...]
    cpu_seconds: float  # processor time
    provenance: Provenance  # of the record


#: Names of the splits by those of their reference sets.
SPLIT_NAMES: Mapping[str, str] = {"validation": "uniform", "boundary": "boundary"}
REPLANNING_COLUMNS: tuple[Column[ReplanningRow], ...] = (
    Column("initial conditions", lambda row: SPLIT_NAMES[row.split]),
    Column("condition", lambda row: row.condition),
    Column("method", lambda row: row.method),
    Column("success", lambda row: row.success, proportion),
    Column("at the plan's end", lambda row: row.success_at_plan_end and row.success_at_plan_end.count),
    Column("cost / optimal", lambda row: row.relative_cost, ".3f"),
    Column("mean violation, m", lambda row: row.violation_mean, ".3f"),
    Column("changes of the family", lambda row: row.flips),
)


def run_split(
    problem: OptimalControlProblem,
    split: str,
    parameters: Array,
    optimal: Trajectory,
    planner: NetworkPlanner,
    every: float,
    *,
    seed: int = 0,
    dt: float = 0.02,
) -> list[ReplanningRow]:
    """All methods under all conditions from the ``parameters`` (B, np) of the ``split``, with their ``optimal`` plans.

    Plans of ``planner`` for ``problem`` are renewed ``every`` seconds, in control steps of ``dt`` seconds; pushes are
    drawn with ``seed``.
    """
    p, rows, stored = parameters, list[ReplanningRow](), StoredPlans(parameters, optimal, problem)
    when, change = pushes(problem, optimal.duration, dt, seed)
    envs = environments(problem, len(p), dt)
    baseline = rollout(envs, TrackingPolicy(problem, stored, dt), p)
    for condition in conditions(problem):
        for name, policy in methods(problem, planner, stored, every, condition).items():
            moved = condition.environments(problem, when, change, dt)
            watched = Observed(policy, round(every / dt))
            metrics = evaluate(problem, episodes := rollout(moved, watched, p))
            last = watched.last
            rows.append(
                ReplanningRow(
                    split=split,
                    condition=condition.name,
                    method=name,
                    success=metrics.success,
                    success_at_plan_end=metrics.success_at_plan_end,
                    left_box=metrics.left_box,
                    relative_cost=cost_ratio(episodes, baseline).ratio,
                    violation_mean=None if metrics.violation is None else metrics.violation.mean.mean,
                    flips=None if last is None else int(last.flips.sum()),
                    renewals=None if last is None else int(last.renewals.sum()),
                )
            )
    return rows


def latency(
    problem: OptimalControlProblem,
    parameters: Array,
    optimal: Trajectory,
    planner: NetworkPlanner,
    every: float,
    count: int,
    *,
    seed: int = 0,
    dt: float = 0.02,
) -> tuple[Latency, ...]:
    """How long renewals take in the first ``count`` episodes, one at a time; the arguments are as for `run_split`."""
    when, change = pushes(problem, optimal.duration, dt, seed)
    found, stored = [], StoredPlans(parameters, optimal, problem)
    for condition in conditions(problem)[:2]:
        name = f"{planner.name}, replanned"
        watched = Observed(methods(problem, planner, stored, every, condition)[name], round(every / dt))
        for row in range(count):
            rows = slice(row, row + 1)
            moved = condition.environments(problem, when[rows], change[rows], dt)
            rollout(moved, watched, parameters[rows])
        milliseconds = 1000 * np.array(watched.seconds[5:])  # the first ones start the solver
        found.append(
            Latency(
                condition=condition.name,
                count=len(milliseconds),
                median=float(np.median(milliseconds)),
                percentile_99=float(np.quantile(milliseconds, 0.99)),
                load=os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
            )
        )
    return tuple(found)
