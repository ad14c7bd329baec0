"""The overview: a few metrics of each problem, made from its comparison and from trainings with several seeds.

Of several learners, or several mixtures over k-means clusters, the one that the benchmark names is shown: to pick the
best on the validation set would be a choice made on validation data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from moe_policy.experiments.benchmark.parts import Overview
from moe_policy.experiments.checking import CHECKED
from moe_policy.experiments.comparison import Comparison, ComparisonRow
from moe_policy.experiments.learners import LearnerTraining
from moe_policy.experiments.seeds import Range, TrainingRow
from moe_policy.experiments.splits import SeedsRow
from moe_policy.reports.metric_columns import COST, METRICS
from moe_policy.reports.records import ABSENT, Absent, Record, inline
from moe_policy.reports.tables import Column, with_range
from moe_policy.rollouts.metrics import TOLERANCES, Metrics
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


#: What is shown of networks that were trained with equal settings, by the key of the metric.
EQUALLY_TRAINED = {
    "success_clear_0.01": "within 1 cm",
    "success_clear_0.05": "within 5 cm",
    "violation_mean": "mean violation on the whole path, m",
}
#: The mixture over families that continuation finds.
FOUND = "moe-auto"
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
        "MoE, found": FOUND,
        "MoE, checked": CHECKED,
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


@dataclass(frozen=True, eq=False)
class Sources:
    """What the overview of one problem is made from."""

    comparison: Comparison  # all methods, networks with one training seed
    trained: Sequence[TrainingRow] = ()  # networks over several seeds, on the same instances
    learners: Mapping[str, Sequence[LearnerTraining]] = field(default_factory=dict)  # learners over several seeds
    seeds: Sequence[SeedsRow] = ()  # networks over several seeds that were trained with equal settings
    others: Sequence[ComparisonRow] = ()  # methods that other records compare on the same instances


@dataclass(frozen=True)
class _Measure:
    """A row: what is shown of the metrics of one method, and of a network over its seeds."""

    title: str
    of: Callable[[Metrics], str | None]
    over_seeds: Callable[[TrainingRow], Range | Absent] = lambda _: ABSENT
    form: str = ".0f"


def overview_rows(sources: Sources, overview: Overview) -> list[OverviewRow]:
    """The rows of one problem.

    The value of a network or a learner that was trained with several seeds is the median with its range. Where
    networks were also trained with equal settings on fewer instances, these have rows of their own.
    """
    comparison, names = sources.comparison, columns(overview)
    rows = {row.name: row for row in (*comparison.rows, *sources.others)}
    shown = {title: rows[name].metrics for title, name in names.items() if name in rows}
    measures = _measures(list(shown.values()), comparison.cases)
    texts = {measure.title: {title: measure.of(found) for title, found in shown.items()} for measure in measures}
    for measure in measures:
        usual = {row.name: row for row in reversed(sources.trained)}
        texts[measure.title] |= _over_seeds(measure, {title: usual.get(name or "") for title, name in names.items()})
    texts[measures[-2].title] |= _learner(sources, overview)
    if named := next((cells for cells in texts.values() if cells.get(RL)), None):
        named[RL] = f"{named[RL]} ({overview.learner})"
    whole: dict[str, dict[str, str | None]] = {**texts, **_equal_training(sources, names)}
    return [
        OverviewRow(env_id="" if i else comparison.env_id, measure=measure, cells=cells)
        for i, (measure, cells) in enumerate(whole.items())
    ]


def _over_seeds(measure: _Measure, rows: Mapping[str, TrainingRow | None]) -> dict[str, str]:
    """The cells of networks with at least two seeds."""
    spreads = {title: measure.over_seeds(row) for title, row in rows.items() if row and len(row.seeds) > 1}
    return {title: with_range(measure.form)(spread) for title, spread in spreads.items() if spread is not ABSENT}


def _equal_training(sources: Sources, names: Mapping[str, str | None]) -> dict[str, dict[str, str | None]]:
    """The rows of networks over seeds with equal settings on fewer instances, where the compared ones have others."""
    if not any(row.name.endswith(" problems") for row in sources.trained):
        return {}
    rows = {title: row for title, name in names.items() for row in sources.seeds if row.name == name}
    texts: dict[str, dict[str, str | None]] = {}
    for metric in METRICS:
        cells = {}
        for title, row in rows.items():
            if (spread := row.splits["uniform"].get(metric.key)) is not None:
                cells[title] = with_range(metric.form)(spread)
        if cells and metric.key in EQUALLY_TRAINED:
            one = next(iter(rows.values()))
            title = f"equal training ({one.samples:,} instances, {one.epochs} epochs): {EQUALLY_TRAINED[metric.key]}"
            texts[f"{title}, of {one.cases['uniform']:,}" if metric.form == "g" else title] = {**cells}
    return texts


def _learner(sources: Sources, overview: Overview) -> dict[str, str]:
    """The cell of the learner's successes, where it was trained with several seeds."""
    counts = [one.validation.success.count for one in sources.learners.get(overview.learner or "", ())]
    spread = Range.of(counts) if len(counts) > 1 else ABSENT
    return {} if spread is ABSENT else {RL: with_range(".0f")(spread)}


def _measures(metrics: Sequence[Metrics], cases: int) -> list[_Measure]:
    """What is shown of ``metrics``; the last but one is success after terminal regulation, or at the plan's end where
    there is none."""
    measures = []
    if any(m.success_clear is not None for m in metrics):
        measures = [_clear(tolerance, cases) for tolerance in TOLERANCES]
        measures.append(
            _Measure("mean violation on the whole path, m", _violation, lambda r: r.violation_spread, ".3f")
        )
    success = f"success of {cases:,}"
    if any(m.success_at_plan_end not in (None, m.success) for m in metrics):
        title = f"success at the plan's end, of {cases:,}"
        measures.append(_Measure(title, _at_plan_end, lambda row: row.success_at_plan_end_spread))
        success = "… after terminal regulation"
    measures.append(_Measure(success, lambda m: str(m.success.count), lambda row: row.success_spread))
    return [*measures, _Measure("cost / optimal", COST.column.cell)]


def _clear(tolerance: float, cases: int) -> _Measure:
    key = f"{tolerance:g}"

    def count(metrics: Metrics) -> str | None:
        return None if metrics.success_clear is None else str(metrics.success_clear[key].count)

    title = f"at the goal, within {100 * tolerance:g} cm of the constraint, of {cases:,}"
    return _Measure(title, count, lambda row: row.clear(key))


def _at_plan_end(metrics: Metrics) -> str | None:
    return None if metrics.success_at_plan_end is None else str(metrics.success_at_plan_end.count)


def _violation(metrics: Metrics) -> str | None:
    return None if metrics.violation is None else f"{metrics.violation.mean.mean:.3f}"
