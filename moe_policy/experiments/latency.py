"""Duration of planning, of solving and of one control step.

Methods take turns, a few instances at a time, so that other load on the machine affects all of them.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.speed.guesses import SolveRow, median_of
from moe_policy.protocols import Planner, Policy
from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column, duration
from moe_policy.rollouts.environments import environments
from moe_policy.score.method import Method
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance

#: Plans in a call. The solver takes minutes for the large one.
BATCHES = (1, 1000)


@dataclass(frozen=True, kw_only=True)
class PlanRow(Record):
    """Seconds for each plan, and the time of the first planner / of this one, by size of the batch."""

    name: str
    seconds: dict[str, float]
    ratio: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class StepRow(Record):
    """Median times of one method: a plan and the gains along it (``None`` for a policy), and a control step."""

    name: str
    plan_seconds: float | None
    regulators_seconds: float | None
    step_seconds: float
    step_share_of_period: float


@dataclass(frozen=True, kw_only=True)
class Latency(Record):
    """Times of planning (the optimal planner first), solving (from random guesses first) and control steps."""

    env_id: str
    cases: int
    dt: float
    planners: tuple[PlanRow, ...]
    solver: tuple[SolveRow, ...]
    steps: tuple[StepRow, ...]
    provenance: Provenance


def time_planner(
    planner: Planner, parameters: ArrayLike, batches: tuple[int, ...] = (1, 1000), repeats: int = 5
) -> dict[str, float]:
    """Seconds per plan by size of the batch: the median over ``repeats`` calls after one to warm up.

    ``parameters`` (n, np) are repeated to fill a batch, and each call gets other rows where there are enough.
    """
    p = np.asarray(parameters, dtype=np.float64)
    seconds = {}
    for batch in batches:
        rows = np.arange((repeats + 1) * batch).reshape(repeats + 1, batch) % len(p)
        planner(p[rows[0]])
        taken = []
        for chosen in rows[1:]:
            began = time.perf_counter()
            planner(p[chosen])
            taken.append(time.perf_counter() - began)
        seconds[str(batch)] = float(np.median(taken)) / batch
    return seconds


def planner_rows(
    planners: Mapping[str, Planner], p: Array, batches: Sequence[int], turns: int = 3, calls: int = 20
) -> tuple[PlanRow, ...]:
    """Seconds for each plan of each planner, medians over its calls; the others are compared with the first one.

    ``p`` (n, np) is repeated to fill the calls. In a turn a batch of 1 is planned ``calls`` times, a larger one once.
    """
    taken: dict[tuple[str, int], list[float]] = defaultdict(list)
    for planner in planners.values():  # starts processes, compiles
        planner(p[:2])
    for turn in range(turns):
        for name, planner in planners.items():
            for batch in batches:
                each = calls if batch == 1 else 1
                for call in range(turn * each, (turn + 1) * each):
                    rows = p[np.arange(call * batch, (call + 1) * batch) % len(p)]
                    began = time.perf_counter()
                    planner(rows)
                    taken[name, batch].append((time.perf_counter() - began) / batch)
    seconds = {name: {str(batch): float(np.median(taken[name, batch])) for batch in batches} for name in planners}
    first = seconds[next(iter(planners))]
    return tuple(
        PlanRow(name=name, seconds=own, ratio={batch: first[batch] / value for batch, value in own.items()})
        for name, own in seconds.items()
    )


def step_rows(
    problem: OptimalControlProblem, methods: Sequence[Method], p: Array, dt: float = 0.02, steps: int = 50
) -> tuple[StepRow, ...]:
    """Seconds of a control step of one environment, and of what a planner does before the first one.

    Episodes of at most ``steps`` steps begin from ``p`` (B, np), B ≥ 2, of which the first one warms up.
    """
    policies = {method.name: method.policy(problem, dt) for method in methods}
    taken: dict[tuple[str, str], list[float]] = defaultdict(list)
    envs = environments(problem, 1, dt)
    for number, row in enumerate(p):
        for name, policy in policies.items():
            for part, seconds in _episode(envs, policy, row[None], steps):
                if number:
                    taken[name, part].append(seconds)
    envs.close()
    return tuple(
        StepRow(
            name=name,
            plan_seconds=median_of(taken[name, "plan"]),
            regulators_seconds=median_of(taken[name, "regulators"]),
            step_seconds=float(np.median(taken[name, "step"])),
            step_share_of_period=float(np.median(taken[name, "step"])) / dt,
        )
        for name in policies
    )


def _episode(envs: VectorEnv, policy: Policy, p: Array, steps: int) -> list[tuple[str, float]]:
    """Parts of an episode from ``p`` (1, np) with their durations in seconds: "plan", "regulators", each "step"."""
    observation, _ = envs.reset(options={"parameters": p, "extrapolate": True})
    state: object = None
    taken = []
    if isinstance(policy, TrackingPolicy):
        began = time.perf_counter()
        plan = policy.planner(p)
        planned = time.perf_counter()
        state = policy.follow(plan, envs.problem.start(p)[1])
        taken += [("plan", planned - began), ("regulators", time.perf_counter() - planned)]
    for step in range(steps):
        began = time.perf_counter()
        action, state = policy.predict(observation, state, np.array([step == 0 and state is None]))
        taken.append(("step", time.perf_counter() - began))
        observation, _, terminated, _, _ = envs.step(action)
        if terminated.any():
            break
    return taken


@dataclass(frozen=True)
class PolicyLatency:
    """A row of the table of planners and policies, of which a method may have but one part.

    ``solver_seconds`` is the time of the first planner for a batch of one plan.
    """

    name: str
    plan: PlanRow | None
    step: StepRow | None
    solver_seconds: float | None

    def at(self, what: str, batch: int) -> float | None:
        """Value of the field ``what`` of ``plan`` for a batch of ``batch`` plans, if there is one."""
        return None if self.plan is None else getattr(self.plan, what).get(str(batch))

    @property
    def regulators(self) -> float | None:
        """Seconds for the regulators of one plan."""
        return None if self.step is None else self.step.regulators_seconds

    def with_regulators(self, plan_seconds: float | None) -> float | None:
        """Seconds for one plan, which itself takes ``plan_seconds``, and its regulators."""
        return None if plan_seconds is None or self.regulators is None else plan_seconds + self.regulators

    @property
    def ready(self) -> float | None:
        """Seconds for one plan and its regulators: after them the first control step can be taken."""
        return self.with_regulators(self.at("seconds", 1))

    @property
    def ratio_ready(self) -> float | None:
        """Time of the first planner / of this one, both with these regulators."""
        solver, own = self.with_regulators(self.solver_seconds), self.ready
        return None if solver is None or own is None else solver / own


def planning_rows(record: Latency) -> tuple[PolicyLatency, ...]:
    """Planners and policies of ``record``, a row each."""
    plans, steps = {row.name: row for row in record.planners}, {row.name: row for row in record.steps}
    solver = record.planners[0].seconds.get("1") if record.planners else None
    return tuple(
        PolicyLatency(name, plans.get(name), steps.get(name), solver) for name in dict.fromkeys((*plans, *steps))
    )


def _of_batch(title: str, what: str, batch: int, form: Callable[[float], str]) -> Column[PolicyLatency]:
    return Column(f"{title}{batch:,}", lambda row: row.at(what, batch), form)


_ratio = "{:,.3g}".format
PLANNING_COLUMNS: tuple[Column[PolicyLatency], ...] = (
    Column("policy", lambda row: row.name),
    *(_of_batch("a plan, batch of ", "seconds", batch, duration) for batch in BATCHES),
    *(_of_batch("solver's time / its, ", "ratio", batch, _ratio) for batch in BATCHES),
    Column("regulators", lambda row: row.regulators, duration),
    Column("a plan and its regulators, batch of 1", lambda row: row.ready, duration),
    Column("solver's time / its, both with regulators, 1", lambda row: row.ratio_ready, _ratio),
    Column("a control step", lambda row: row.step and row.step.step_seconds, duration),
    Column("fraction of the period", lambda row: row.step and row.step.step_share_of_period, ".2%"),
)
