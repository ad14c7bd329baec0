"""The table of methods on splits: on each split a line for each method, or for all training seeds of one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby

from moe_policy.reports.metric_columns import METRICS, Metric
from moe_policy.reports.tables import Column, with_range
from moe_policy.rollouts.intervals import Spread
from moe_policy.rollouts.metrics import Metrics


@dataclass(frozen=True, eq=False)
class Line:
    """One method on one split, or all its training seeds.

    Args:
        split: name of the split.
        name: of the method.
        metrics: of one training.
        spreads: by measure, over the seeds, where there are several.
    """

    split: str
    name: str
    metrics: Metrics | None = None
    spreads: Mapping[str, Spread] = field(default_factory=dict)


def by_split(found: Iterable[Line]) -> list[Line]:
    """The lines ``found`` with the name of their split in the first line of each alone."""
    return [
        replace(line, split=line.split if i == 0 else "")
        for _, group in groupby(found, key=lambda line: line.split)
        for i, line in enumerate(group)
    ]


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
