"""Curves of success on perturbed plants, and where there is an obstacle, of how far it is entered."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from moe_policy.experiments.figures.style import looks, save_figure
from moe_policy.experiments.perturbations import Perturbation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Record = Mapping[str, Any]

COLUMNS = 3
#: Levels from 0 whose largest is more than so many times their smallest are drawn on a logarithmic axis.
_WIDE = 15


def robustness_figure(
    path: str | os.PathLike[str], rows: Sequence[Record], perturbations: Sequence[Perturbation]
) -> Path:
    """A panel for each perturbation: success against the level, a curve with its 95 % band for each method.

    Dashed where a plan is followed by a hold: success at its end, before the hold. Where there are path constraints, as
    many panels follow with the mean violation over the whole path.

    Args:
        path: file to write.
        rows: of :func:`~moe_policy.experiments.robustness.run_level`, each with its ``perturbation`` and ``level``.
        perturbations: what the panels show.
    """
    names = list(dict.fromkeys(row["name"] for row in rows))  # in the order, and so the colours, of the comparison
    metrics = ["success"] + ["violation_mean"] * any(row["violation_mean"] is not None for row in rows)
    lines = -(-len(perturbations) // COLUMNS)

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(lines * len(metrics), COLUMNS, squeeze=False)
        for metric, block in zip(metrics, panels.reshape(len(metrics), -1)):
            for axes, perturbation in zip(block, perturbations):
                draw_curves(axes, [row for row in rows if row["perturbation"] == perturbation.name], names, metric)
                if perturbation.levels[0] == 0 and perturbation.levels[-1] > _WIDE * perturbation.levels[1]:
                    axes.set_xscale("symlog", linthresh=perturbation.levels[1])
                    axes.xaxis.set_major_formatter("{x:g}")
                    axes.set_xlim(left=0)
                axes.set_xlabel(f"{perturbation.label}, {perturbation.unit}")
            for axes in block[::COLUMNS]:
                axes.set_ylabel("success, %" if metric == "success" else "mean violation, m")
            for axes in block[len(perturbations) :]:
                axes.set_axis_off()
        title = "dashed: at the plan's end, before the hold" if any(map(_held, rows)) else None
        handles = panels[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=min(len(names), 8), title=title)

    return save_figure(path, (10.0, 0.8 + 2.6 * lines * len(metrics)), draw)


def draw_curves(axes: Axes, rows: Sequence[Record], names: Sequence[str], metric: str) -> None:
    """``metric`` of each of ``names`` against the level; ``rows`` are those of one perturbation."""
    for name, look in looks(names).items():
        points = [row for row in rows if row["name"] == name]
        style: dict[str, Any] = {"color": look["color"], "linewidth": 1.2}
        mark = {"marker": "o", "markersize": 2.5, "label": name}
        levels = [row["level"] for row in points]
        if metric != "success":
            axes.plot(levels, [row[metric] for row in points], **style, **mark)
            continue
        low, high = ([100 * row["success"]["interval"][side] for row in points] for side in (0, 1))
        axes.fill_between(levels, low, high, color=style["color"], alpha=0.15, linewidth=0)
        axes.plot(levels, [100 * row["success"]["fraction"] for row in points], **style, **mark)
        if any(map(_held, points)):
            ends = [100 * row["success_at_plan_end"]["fraction"] for row in points]
            axes.plot(levels, ends, "--", color=style["color"], linewidth=0.8)
    axes.set_ylim(*((-3, 103) if metric == "success" else (0, None)))


def _held(row: Record) -> bool:
    """Whether the figures tell success from success at the plan's end."""
    return row["success_at_plan_end"] is not None and row["success_at_plan_end"] != row["success"]
