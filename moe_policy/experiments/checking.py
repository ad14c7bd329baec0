"""Planners as they are, repaired and checked, on the splits of a problem."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from moe_policy import store
from moe_policy.checking.checked import Checked
from moe_policy.checking.shipped import SHIPPED
from moe_policy.checking.verdict import HOW, CheckedPlans
from moe_policy.experiments.comparison import ComparisonRow, Optimum, run
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.repaired import Repaired
from moe_policy.planners.stored import StoredPlans
from moe_policy.protocols import Planner
from moe_policy.reports.records import ABSENT, Absent, Record, inline, read, write
from moe_policy.rollouts.conformal import coverage_range, least_success, upper_bound
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import TOLERANCES
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.provenance import Provenance

#: Iterations with which plans are repaired; ``None`` until the solver converges.
ITERATIONS: tuple[int | None, ...] = (3, 5, 10, None)
#: Name of the row of the checked planner.
CHECKED = "checked"


@dataclass(frozen=True, kw_only=True)
class Making(Record):
    """How the plans of a checked planner were made."""

    chosen: int  # plans as an expert predicted them
    repaired: int  # plans that some iterations of the solver improved
    solved: int  # solutions
    abstained: int  # instances without a plan
    verified: int  # plans that the planner says will succeed
    wrong: int  # those of them that do not

    @classmethod
    def of(cls, checked: CheckedPlans, kept: Bools) -> Self:
        """How the plans of ``checked`` were made, of which those ``kept`` (B,) what was promised."""
        counts = {how: checked.count(how) for how in HOW}
        wrong = int((checked.verified & ~kept).sum())
        return cls(**counts, verified=int(checked.verified.sum()), wrong=wrong)


@dataclass(frozen=True, kw_only=True)
class CheckRow(Record):
    """One planner on one split."""

    row: ComparisonRow = inline()  # as in a comparison
    making: Making | Absent = ABSENT  # of a checked planner


@dataclass(frozen=True, kw_only=True)
class Measured(Record):
    """What is kept of one planner on one split."""

    row: CheckRow  # as in the record
    #: cost of each episode relative to that of the optimum; ``None`` where it does not end at the goal with its plan,
    #: or enters a constraint by more than 1 cm
    costs: tuple[float | None, ...]

    @property
    def scores(self) -> Array:
        """The costs with +inf for ``None``, (B,)."""
        return np.array([np.inf if cost is None else cost for cost in self.costs])


@dataclass(frozen=True, kw_only=True)
class BoundRow(Record):
    """What is promised of one planner on fresh instances, calibrated on the development set.

    At most the fraction 1 − level of fresh instances fails or costs more than the bound, see
    :mod:`moe_policy.rollouts.conformal`. Failing is not to end at the goal with the plan, or to enter a constraint by
    more than 1 cm.
    """

    name: str  # of the planner
    level: float  # probability that a fresh instance is below the bound
    calibration: int  # number of development instances
    cost_bound: float | None  # of the cost relative to that of the optimum; ``None`` where there is none
    coverage: Proportion | None  # validation instances below the bound; ``None`` without one
    coverage_range: tuple[float, float]  # in which the coverage of 95 % of all calibrations lies
    success: Proportion  # development instances that do not fail
    success_bound: float  # what the probability of success exceeds with the confidence of the level
    success_measured: Proportion  # validation instances that do not fail

    @classmethod
    def of(cls, name: str, calibration: Array, fresh: Array, level: float) -> Self:
        """The promise for the planner called ``name``, with its scores in ``calibration`` (n,) and ``fresh`` (m,)."""
        bound, good = upper_bound(calibration, level), np.isfinite(calibration)
        return cls(
            name=name,
            level=level,
            calibration=len(calibration),
            cost_bound=None if np.isinf(bound) else bound,
            coverage=None if np.isinf(bound) else Proportion.of(fresh <= bound),
            coverage_range=coverage_range(len(calibration), level),
            success=Proportion.of(good),
            success_bound=least_success(good, level),
            success_measured=Proportion.of(np.isfinite(fresh)),
        )


@dataclass(frozen=True, kw_only=True)
class PlanTime(Record):
    """How long plans of one planner take, each alone; with their regulators the first control step can be taken."""

    name: str  # of the planner
    cases: int  # number of instances
    median: float  # seconds
    quantile_99: float  # seconds, exceeded by one plan in a hundred

    @classmethod
    def of(cls, name: str, planner: Planner, p: Array) -> Self:
        """The times of ``planner``, called ``name``, for each row of ``p`` (B, np), after a first one to warm up."""
        planner(p[:1])
        seconds = []
        for row in p:
            began = time.perf_counter()
            planner(row[None])
            seconds.append(time.perf_counter() - began)
        median, high = np.quantile(seconds, [0.5, 0.99])
        return cls(name=name, cases=len(p), median=float(median), quantile_99=float(high))


@dataclass(frozen=True, kw_only=True)
class PlannerChecks(Record):
    """All planners of one problem on its splits: ``planners_checked_<env>.json``."""

    env_id: str  # id of the problem
    splits: dict[str, tuple[CheckRow, ...]]  # by split; the optimum first
    times: tuple[PlanTime, ...]  # on the instances of the first split
    bounds: tuple[BoundRow, ...]  # of the planners that are not repaired
    seconds: float  # duration of the run, without what earlier runs kept
    provenance: Provenance  # of the record


def planners(problem: OptimalControlProblem, methods: Sequence[Method]) -> list[Method]:
    """The planners among ``methods``, each as it is and repaired with :data:`ITERATIONS`, and the checked planner."""
    plain = [method for method in methods if method.planner is not None]
    found = []
    for method in plain:
        assert method.planner is not None
        found.append(method)
        for iterations in ITERATIONS:
            planner = Repaired(method.planner, iterations)
            found.append(replace(method, name=planner.name, actor=planner))
    return [*found, Method(CHECKED, store.load(problem, CHECKED, kind=Checked))]


def checked_row(path: Path, cases: int) -> ComparisonRow | None:
    """The row of the checked planner on ``cases`` validation instances in the record ``path``; ``None`` without."""
    rows = read(path, PlannerChecks).splits["uniform"] if path.exists() else ()
    found = [row.row for row in rows if row.row.name == CHECKED and row.row.metrics.success.total == cases]
    return found[0] if found else None


def effort_of(name: str) -> tuple[str, str]:
    """The name of the planner that is repaired under ``name``, and how: "", "3 iterations" … or "converged"."""
    planner, repaired, effort = name.partition(", repaired")
    return planner, (effort.removeprefix(", ") or "converged") if repaired else ""


def measure(problem: OptimalControlProblem, method: Method, p: Array, optimum: Optimum) -> Measured:
    """Roll ``method`` out from ``p`` (B, np) and compare its verdicts, if it has any, with what happens.

    Costs are compared with those of the ``optimum``.
    """
    baseline = optimum.baseline[: len(p)]
    planner = method.actor
    if not isinstance(planner, Checked):
        row, episodes = run(problem, method, p, baseline=baseline, batches=())
        return Measured(row=CheckRow(row=row), costs=relative_costs(problem, episodes, baseline))
    checked = planner.check(p)
    flown = replace(method, actor=StoredPlans(p, checked.trajectory))
    row, episodes = run(problem, flown, p, baseline=baseline, batches=())
    made = CheckRow(row=row, making=Making.of(checked, kept_promise(problem, episodes)))
    return Measured(row=made, costs=relative_costs(problem, episodes, baseline))


def relative_costs(problem: OptimalControlProblem, episodes: Episodes, baseline: Episodes) -> tuple[float | None, ...]:
    """The costs of ``episodes`` of ``problem`` relative to those of the ``baseline``, see :class:`Measured`."""
    good = (episodes.plan_end_error < problem.goal.radius) & episodes.clear(TOLERANCES[0]) & ~episodes.left_box
    ratios = episodes.cost / np.where(baseline.cost > 0, baseline.cost, np.nan)
    # An instance that begins at the goal costs nothing.
    ratios = np.where(np.isnan(ratios) & (episodes.cost == baseline.cost), 1.0, ratios)
    return tuple(float(ratio) if fine and np.isfinite(ratio) else None for ratio, fine in zip(ratios, good))


def kept_promise(problem: OptimalControlProblem, episodes: Episodes) -> Bools:
    """Which ``episodes`` of ``problem`` end at the goal with their plan and keep all constraints on their way, (B,)."""
    clear = (episodes.violation == 0) & ~(episodes.knot_violation > 0)
    return (episodes.plan_end_error < problem.goal.radius) & clear & ~episodes.left_box & ~episodes.rejected


def kept(problem: OptimalControlProblem, method: Method, p: Array, optimum: Optimum, folder: Path) -> Measured:
    """:func:`measure` of ``problem``, ``method``, ``p`` and ``optimum``; it is kept in ``folder``.

    It counts for its problem, parameters, planner and the settings of the checked planner alone.
    """
    settings = SHIPPED.get(problem.id) if isinstance(method.actor, Checked) else None
    key = hashlib.sha256(f"{problem.fingerprint} {method.name} {settings}".encode())
    key.update(np.ascontiguousarray(p).tobytes())
    if isinstance(method.actor, NetworkPlanner):
        key.update(method.actor(p[:1]).flat().tobytes())
    path = folder / f"{key.hexdigest()[:16]}.json"
    if path.exists():
        return read(path, Measured)
    measured = measure(problem, method, p, optimum)
    folder.mkdir(parents=True, exist_ok=True)
    write(path, measured)
    return measured
