"""The table of a comparison on splits: on each split a line for each method, and for all seeds of a network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from moe_policy.experiments.splits import SplitComparison
from moe_policy.reports.metric_columns import METRICS, Metric
from moe_policy.reports.records import present
from moe_policy.reports.tables import Column, with_range
from moe_policy.rollouts.intervals import Spread
from moe_policy.rollouts.metrics import Metrics


@dataclass(frozen=True, eq=False)
class Line:
    """One method on one split, or all training seeds of a network."""

    split: str  # empty but in the first line of a split
    name: str  # of the method
    metrics: Metrics | None = None  # of one method
    spreads: Mapping[str, Spread] = field(default_factory=dict)  # by measure, over the seeds


def lines(record: SplitComparison) -> list[Line]:
    """The lines of the table of ``record``, split by split."""
    found = []
    for split in record.splits:
        rows = [Line(split, method.name, method.splits[split].row.metrics) for method in record.rows]
        rows += [Line(split, row.label(split), spreads=row.splits[split]) for row in present(record.seeds) or ()]
        found += [line if i == 0 else replace(line, split="") for i, line in enumerate(rows)]
    return found


def _column(metric: Metric) -> Column[Line]:
    """``metric`` of one method; over seeds its median and range, as ``471 (400–478)``."""

    def of(line: Line) -> Line | None:
        known = line.spreads.get(metric.key) if line.metrics is None else metric.value(line.metrics)
        return None if known is None else line

    def text(line: Line) -> str:
        if line.metrics is not None:
            return metric.column.cell(line.metrics)
        return with_range(metric.form)(line.spreads[metric.key])

    return Column(metric.column.title, of, text)


SPLIT_COLUMNS: tuple[Column[Line], ...] = (
    Column("split", lambda line: line.split),
    Column("policy", lambda line: line.name),
    *map(_column, METRICS),
)
