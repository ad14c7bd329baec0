"""The overview: a few metrics of each problem, made from its comparison.

Of several learners, or several mixtures over k-means clusters, the one that the benchmark names is shown: to pick the
best on the validation set would be a choice made on validation data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from moe_policy.experiments.benchmark.parts import Overview
from moe_policy.experiments.comparison import Comparison
from moe_policy.experiments.records import Record, inline
from moe_policy.experiments.tables import Column
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import Metrics
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class OverviewRow(Record):
    """One metric of one problem."""

    env_id: str  # id of the problem; empty but in its first row
    measure: str  # what is shown
    cells: dict[str, str | None] = inline()  # text by the title of the column; methods that are lacking have none


@dataclass(frozen=True, kw_only=True)
class OverviewTable(Record):
    """The overview: ``table_overview.json``."""

    quick: bool  # whether it is made from few cases
    rows: tuple[OverviewRow, ...]  # all rows
    provenance: Provenance  # of the record


#: Title of the column of the learner, whose name follows its first value.
RL = "RL"


def columns(overview: Overview) -> dict[str, str | None]:
    """The name of the method in each column of methods, by the column's title."""
    return {
        "optimal": "optimal",
        "nearest": "nearest",
        "SNN": "snn",
        "MoE, custom": "moe-custom",
        "MoE, k-means": overview.kmeans,
        RL: overview.learner,
        "stabiliser": "stabiliser",
    }


def _cell(title: str, row: OverviewRow) -> str | None:
    return row.cells.get(title)


OVERVIEW_COLUMNS: tuple[Column[OverviewRow], ...] = (
    Column("problem", lambda row: row.env_id),
    Column("measure", lambda row: row.measure),
    *(Column(title, partial(_cell, title)) for title in columns(Overview())),
)


def overview_rows(comparison: Comparison, overview: Overview) -> list[OverviewRow]:
    """The rows of one problem."""
    rows = {row.name: row for row in comparison.rows}
    shown = {title: rows[name] for title, name in columns(overview).items() if name in rows}
    measures = _measures([row.metrics for row in shown.values()], comparison.cases)
    texts = {measure: {title: of(row.metrics) for title, row in shown.items()} for measure, of in measures.items()}
    if named := next((cells for cells in texts.values() if cells.get(RL)), None):
        named[RL] = f"{named[RL]} ({shown[RL].name})"
    return [
        OverviewRow(env_id="" if i else comparison.env_id, measure=measure, cells=cells)
        for i, (measure, cells) in enumerate(texts.items())
    ]


def _measures(metrics: Sequence[Metrics], cases: int) -> dict[str, Callable[[Metrics], str | None]]:
    """What is shown of ``metrics``, by its title; both successes where terminal regulation changes any of them."""
    measures: dict[str, Callable[[Metrics], str | None]] = {}
    if any(m.knot_violation_mean is not None for m in metrics):
        measures["mean violation, m"] = lambda m: _three(m.knot_violation_mean)
    measures[f"success of {cases:,}"] = lambda m: _count(m.success)
    if any(m.success_at_plan_end not in (None, m.success) for m in metrics):
        measures["… at the plan's end"] = lambda m: _count(m.success_at_plan_end)
    return measures | {"cost / optimal": lambda m: _three(m.relative_cost)}


def _count(value: Proportion | None) -> str | None:
    return None if value is None else str(value.count)


def _three(value: float | None) -> str | None:
    return None if value is None else f"{value:.3f}"
