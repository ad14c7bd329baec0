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
from moe_policy.experiments.methods import Method
from moe_policy.experiments.metric_columns import METRICS
from moe_policy.experiments.records import ABSENT, Absent, Record, inline, present, read, write
from moe_policy.experiments.tables import Column, duration
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.repaired import Repaired
from moe_policy.planners.stored import StoredPlans
from moe_policy.protocols import Planner
from moe_policy.rollouts.episodes import Episodes
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


def check_row(problem: OptimalControlProblem, method: Method, p: Array, optimum: Optimum) -> CheckRow:
    """Roll ``method`` out from ``p`` (B, np) and compare its verdicts, if it has any, with what happens.

    Costs are compared with those of the ``optimum``.
    """
    baseline = optimum.baseline[: len(p)]
    planner = method.actor
    if not isinstance(planner, Checked):
        row, _ = run(problem, method, p, baseline=baseline, batches=())
        return CheckRow(row=row)
    checked = planner.check(p)
    flown = replace(method, actor=StoredPlans(p, checked.trajectory))
    row, episodes = run(problem, flown, p, baseline=baseline, batches=())
    return CheckRow(row=row, making=Making.of(checked, kept_promise(problem, episodes)))


def kept_promise(problem: OptimalControlProblem, episodes: Episodes) -> Bools:
    """Which ``episodes`` of ``problem`` end at the goal with their plan and keep all constraints on their way, (B,)."""
    clear = (episodes.violation == 0) & ~(episodes.knot_violation > 0)
    return (episodes.plan_end_error < problem.goal.radius) & clear & ~episodes.left_box & ~episodes.rejected


def kept_row(problem: OptimalControlProblem, method: Method, p: Array, optimum: Optimum, folder: Path) -> CheckRow:
    """:func:`check_row` of ``problem``, ``method``, ``p`` and ``optimum``; the row is kept in ``folder``.

    A row counts for its problem, parameters, planner and the settings of the checked planner alone.
    """
    settings = SHIPPED.get(problem.id) if isinstance(method.actor, Checked) else None
    key = hashlib.sha256(f"{problem.fingerprint} {method.name} {settings}".encode())
    key.update(np.ascontiguousarray(p).tobytes())
    if isinstance(method.actor, NetworkPlanner):
        key.update(method.actor(p[:1]).flat().tobytes())
    path = folder / f"{key.hexdigest()[:16]}.json"
    if path.exists():
        return read(path, CheckRow)
    row = check_row(problem, method, p, optimum)
    folder.mkdir(parents=True, exist_ok=True)
    write(path, row)
    return row


def _made(what: str) -> Column[CheckRow]:
    def of(row: CheckRow) -> int | None:
        making = present(row.making)
        return None if making is None else getattr(making, what)

    return Column(what, of, ",")


@dataclass(frozen=True, eq=False)
class Line:
    """One planner on one split, a line of the table."""

    split: str  # empty but in the first line of a split
    row: CheckRow


def lines(record: PlannerChecks) -> list[Line]:
    """The lines of the table of ``record``, split by split."""
    return [
        Line("" if i else f"{split}, of {rows[0].row.metrics.success.total:,}", row)
        for split, rows in record.splits.items()
        for i, row in enumerate(rows)
    ]


CHECK_COLUMNS: tuple[Column[Line], ...] = (
    Column("split", lambda line: line.split),
    Column("planner", lambda line: line.row.row.name),
    *(metric.column.of_part(lambda line: line.row.row.metrics) for metric in METRICS),
    *(_made(what).of_part(lambda line: line.row) for what in (*HOW, "verified", "wrong")),
)
TIME_COLUMNS: tuple[Column[PlanTime], ...] = (
    Column("planner", lambda row: row.name),
    Column("a plan, median", lambda row: row.median, duration),
    Column("… exceeded by 1 %", lambda row: row.quantile_99, duration),
)
