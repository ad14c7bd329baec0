"""Rates against the size of the batch, with what limits each end, and against the workers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from moe_policy.experiments.figures.style import Axes, Figure, cluster_color, save_figure
from moe_policy.experiments.speed.scaling import BatchRow, Scaling, WorkerRow
from moe_policy.reports.tables import duration

_TITLES = {"steps": "control steps", "plans": "plans", "solves": "solves"}
#: Quantities whose rates range over decades.
_LOGARITHMIC = ("steps", "plans")
_MARKERS = "osD^vPX*<>hp"
Row = TypeVar("Row")


def scaling_figure(record: Scaling, path: Path) -> Path:
    """A column of two panels for each quantity of ``record``, saved at ``path``: batches above, workers below."""
    quantities = list(dict.fromkeys(row.quantity for row in record.batches))

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, len(quantities), squeeze=False, height_ratios=(2, 1))
        for (above, below), quantity in zip(panels.T, quantities):
            _batches(above, quantity, [row for row in record.batches if row.quantity == quantity])
            _workers(below, [row for row in record.workers if row.quantity == quantity])
        panels[0, 0].legend(loc="lower right", fontsize="small")
        panels[1, 0].set_ylabel("rate / that of one worker")

    return save_figure(path, (3.5 * len(quantities), 6.0), draw)


def _marked(rows: Sequence[Row]) -> Iterator[tuple[Row, str, str]]:
    """``rows`` of problems, each with its colour and its marker."""
    for i, row in enumerate(rows):
        yield row, cluster_color(i), _MARKERS[i % len(_MARKERS)]


def _batches(axes: Axes, quantity: str, rows: Sequence[BatchRow]) -> None:
    for row, color, marker in _marked(rows):
        sizes = [int(size) for size in row.per_second]
        axes.plot(sizes, list(row.per_second.values()), color=color, marker=marker, ms=4, label=row.env_id)
        model = [size / (row.call_seconds + size * row.row_seconds) for size in sizes]
        axes.plot(sizes, model, color=color, linestyle=":", linewidth=1)
    axes.set_xscale("log")
    if quantity in _LOGARITHMIC:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)
    axes.set(title=f"{_TITLES.get(quantity, quantity)} per second, one process", xlabel=_limits(rows))


def _limits(rows: Sequence[BatchRow]) -> str:
    """What limits small batches and large ones: the time of a call and the time of a row, over the problems."""
    calls, per_row = ([getattr(row, name) for row in rows] for name in ("call_seconds", "row_seconds"))
    left, right = (f"{duration(min(each))} to {duration(max(each))}" for each in (calls, per_row))
    return f"rows in a batch\n(left: each call takes {left};\nright: each row takes {right})"


def _workers(axes: Axes, rows: Sequence[WorkerRow]) -> None:
    for row, color, marker in _marked(rows):
        ratios = row.ratio_to_one
        axes.plot(list(ratios), list(ratios.values()), color=color, marker=marker, ms=5, linestyle="none")
    axes.margins(x=0.2, y=0.1)
    axes.set_ylim(bottom=0.0)
