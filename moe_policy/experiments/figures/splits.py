"""The figure of the splits: each policy against the distance from the jump, and on every split.

Drawn from the record of scripts/compare_splits.py alone; see :mod:`moe_policy.experiments.splits` for what it holds.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from moe_policy.experiments.figures.style import looks, save_figure
from moe_policy.experiments.splits import SPLITS, metrics_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import discontinuity_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Record = Mapping[str, Any]

_MARKERS = dict(zip(SPLITS, "oDs"))


def splits_figure(path: str | os.PathLike[str], problem: OptimalControlProblem, record: Record) -> Path:
    """One row of panels for each metric of ``problem``.

    Left: the metric against the distance from the jump, a curve for each policy with its 95 % band; without a jump this
    column is left out. Right: the metric on every split, a mark for each, with its 95 % interval.

    Args:
        path: file to write.
        problem: the problem.
        record: of scripts/compare_splits.py.
    """
    labels, jump = metrics_of(problem), record.get("curves") is not None
    discontinuity = discontinuity_of(problem)
    names = [row["name"] for row in record["rows"]]
    styles = looks(names)

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(len(labels), 1 + jump, squeeze=False)
        for row, (metric, label) in zip(panels, labels.items()):
            if jump:
                draw_curves(row[0], record["curves"], metric, styles)
                row[0].set(xlabel=discontinuity.label if discontinuity else "", ylabel=label)
            draw_splits(row[-1], record["rows"], metric, styles)
            row[-1].set_xlabel(label)
        _legends(figure, panels)

    height = max(2.6, 1.2 + 0.3 * len(names))
    return save_figure(path, (11.0 if jump else 6.5, height * len(labels)), draw)


def draw_curves(axes: Axes, curves: Record, metric: str, styles: Record) -> None:
    """``metric`` of every policy against the distance from the jump, with the band of its intervals."""
    for name, bins in curves["metrics"][metric].items():
        points = [(x, *_values(entry)) for x, entry in zip(curves["distance"], bins) if entry is not None]
        if not points:
            continue
        x, middle, low, high = zip(*points)
        axes.plot(x, middle, marker="o", markersize=3.5, label=name, **styles[name])
        axes.fill_between(x, low, high, color=styles[name]["color"], alpha=0.15, linewidth=0)
    axes.set_xscale("log")
    _bound(axes, metric, "y")


def draw_splits(axes: Axes, rows: Sequence[Record], metric: str, styles: Record) -> None:
    """``metric`` of every policy on every split, with its interval."""
    there = [split for split in SPLITS if any(split in row for row in rows)]
    for i, row in enumerate(rows):
        for j, split in enumerate(there):
            value = row[split]["judged"][metric] if split in row else None
            if value is None:
                continue
            middle, low, high = _values(value)
            y, color = i + 0.22 * (j - (len(there) - 1) / 2), styles[row["name"]]["color"]
            axes.plot([low, high], [y, y], color=color)
            axes.plot(middle, y, _MARKERS[split], color=color, markersize=4.5, markerfacecolor=color if j == 0 else "w")
    for j, split in enumerate(there):
        face = "#555555" if j == 0 else "w"
        axes.plot([], [], _MARKERS[split], color="#555555", markersize=4.5, markerfacecolor=face, label=split)
    axes.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    _bound(axes, metric, "x")


def _values(value: Record) -> tuple[float, float, float]:
    """Middle, lower and upper end: of a share in per cent, of a mean as it is."""
    low, high = value["interval"]
    if "fraction" in value:
        return 100 * value["fraction"], 100 * low, 100 * high
    return value["mean"], low, high


def _bound(axes: Axes, metric: str, which: str) -> None:
    """Shares up to 100 %, violations from 0."""
    limits: dict[str, Any] = {f"{which}lim": (0, None) if "violation" in metric else (None, 103)}
    axes.set(**limits)


def _legends(figure: Figure, panels: Any) -> None:
    """Policies below all panels, splits in the first panel of theirs."""
    panels[0, -1].legend(fontsize=8, loc="best")
    if panels.shape[1] > 1:
        curves = {text: line for axes in panels[:, 0] for line, text in zip(*axes.get_legend_handles_labels())}
        figure.legend(curves.values(), curves.keys(), loc="outside lower center", ncols=len(curves), fontsize=8)
