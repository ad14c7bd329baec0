"""The tables of planners as they are, repaired and checked."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.checking.verdict import HOW
from moe_policy.experiments.checking import CHECKED, ITERATIONS, BoundRow, CheckRow, PlannerChecks, PlanTime, effort_of
from moe_policy.reports.metric_columns import METRICS
from moe_policy.reports.records import present
from moe_policy.reports.tables import Column, duration, proportion
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import Metrics


@dataclass(frozen=True, eq=False)
class Line:
    """One planner on one split."""

    split: str  # empty but in the first line of a split
    row: CheckRow


@dataclass(frozen=True, eq=False)
class RepairLine:
    """One planner on one split, as it is and repaired."""

    split: str  # empty but in the first line of a split
    name: str  # of the planner
    efforts: dict[str, Metrics]  # by what is done: ``""``, ``"3 iterations"`` …


def _split(name: str, rows: tuple[CheckRow, ...]) -> str:
    return f"{name}, of {rows[0].row.metrics.success.total:,}"


def lines(record: PlannerChecks) -> list[Line]:
    """All lines of ``record``, split by split."""
    return [
        Line("" if i else _split(split, rows), row)
        for split, rows in record.splits.items()
        for i, row in enumerate(rows)
    ]


def checked_lines(record: PlannerChecks) -> list[Line]:
    """The lines of the optimum and of the checked planner in ``record``."""
    return [
        Line("" if i else _split(split, rows), row)
        for split, rows in record.splits.items()
        for i, row in enumerate(row for row in rows if row.row.name in ("optimal", CHECKED))
    ]


def repair_lines(record: PlannerChecks) -> list[RepairLine]:
    """The planners of ``record`` as they are and repaired, split by split."""
    found = []
    for split, rows in record.splits.items():
        planners: dict[str, dict[str, Metrics]] = {}
        for row in rows[1:-1]:  # without the optimum and the checked planner
            name, effort = effort_of(row.row.name)
            planners.setdefault(name, {})[effort] = row.row.metrics
        found += [
            RepairLine("" if i else _split(split, rows), name, efforts)
            for i, (name, efforts) in enumerate(planners.items())
        ]
    return found


def _succeeded(metrics: Metrics) -> Proportion | None:
    """At the goal within 1 cm of the constraints, or at the plan's end where there are none."""
    return metrics.success_at_plan_end if metrics.success_clear is None else metrics.success_clear["0.01"]


def _effort(effort: str) -> Column[RepairLine]:
    def text(metrics: Metrics) -> str:
        succeeded = _succeeded(metrics)
        cost = "" if metrics.relative_cost is None else f", {metrics.relative_cost:.3f}"
        return "–" if succeeded is None else f"{100 * succeeded.fraction:.1f} %{cost}"

    return Column(effort or "as it is", lambda line: line.efforts.get(effort), text)


def _made(what: str) -> Column[CheckRow]:
    def of(row: CheckRow) -> int | None:
        making = present(row.making)
        return None if making is None else getattr(making, what)

    return Column(what, of, ",")


def _metrics(line: Line) -> Metrics:
    return line.row.row.metrics


def _row(line: Line) -> CheckRow:
    return line.row


CHECK_COLUMNS: tuple[Column[Line], ...] = (
    Column("split", lambda line: line.split),
    Column("planner", lambda line: line.row.row.name),
    *(metric.column.of_part(_metrics) for metric in METRICS),
    *(_made(what).of_part(_row) for what in (*HOW, "verified", "wrong")),
)
REPAIR_COLUMNS: tuple[Column[RepairLine], ...] = (
    Column("split", lambda line: line.split),
    Column("planner", lambda line: line.name),
    *map(_effort, ("", *(f"{k} iterations" if k else "converged" for k in ITERATIONS))),
)
TIME_COLUMNS: tuple[Column[PlanTime], ...] = (
    Column("planner", lambda row: row.name),
    Column("a plan, median", lambda row: row.median, duration),
    Column("… exceeded by 1 %", lambda row: row.quantile_99, duration),
)
BOUND_COLUMNS: tuple[Column[BoundRow], ...] = (
    Column("planner", lambda row: row.name),
    Column("succeeds, at least (95 % confidence)", lambda row: row.success_bound, ".2%"),
    Column("… measured", lambda row: row.success_measured, proportion),
    Column("cost / optimal of 95 %, at most", lambda row: row.cost_bound, ".3f"),
    Column("… measured coverage", lambda row: row.coverage, proportion),
)
