"""Success on perturbed plants and, where there is an obstacle, the violation of its constraint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from moe_policy.experiments.figures.style import Axes, Figure, looks, save_figure
from moe_policy.experiments.perturbations import Perturbation
from moe_policy.experiments.robustness import LevelRow, Robustness

COLUMNS = 3
#: Levels from 0 whose maximum is more than so many times the minimum above 0 are drawn on a logarithmic axis.
_WIDE = 15


def robustness_figure(path: str | Path, record: Robustness) -> Path:
    """A panel for each perturbation: success against the level, a curve with its 95 % band for each method.

    Dashed: success at the plan's end, before terminal regulation. Where there are path constraints, as many panels
    follow with the mean violation on the whole path.
    """
    names = record.methods  # in the order, and so the colours, of the comparison
    violated = any(row.outcome.violation_mean is not None for row in record.rows)
    metrics = (SUCCESS, VIOLATION) if violated else (SUCCESS,)
    lines = -(-len(record.perturbations) // COLUMNS)

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(lines * len(metrics), COLUMNS, squeeze=False)
        for metric, block in zip(metrics, panels.reshape(len(metrics), -1)):
            for axes, perturbation in zip(block, record.perturbations):
                draw_panel(axes, record, perturbation, metric)
            for axes in block[::COLUMNS]:
                axes.set_ylabel(metric.title)
            for axes in block[len(record.perturbations) :]:
                axes.set_axis_off()
        matters = any(row.outcome.regulation_matters for row in record.rows)
        title = "dashed: at the plan's end, before the hold" if matters else None
        handles = panels[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=min(len(names), 8), title=title)

    return save_figure(path, (10.0, 0.8 + 2.6 * lines * len(metrics)), draw)


def draw_panel(axes: Axes, record: Robustness, perturbation: Perturbation, metric: Metric) -> None:
    """Draw ``metric`` of all methods in ``record`` against the level of ``perturbation``."""
    for name, look in looks(record.methods).items():
        metric.draw(axes, record.rows_of(perturbation, name), look["color"])
    axes.set_ylim(*metric.limits)  # before the scale of x: the limits of x follow from the linear one
    levels = perturbation.levels
    if levels[0] == 0 and levels[-1] > _WIDE * levels[1]:
        axes.set_xscale("symlog", linthresh=levels[1])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(left=0)
    axes.set_xlabel(f"{perturbation.label}, {perturbation.unit}")


def _draw_success(axes: Axes, rows: Sequence[LevelRow], color: str) -> None:
    """Success of one method against the level, with its interval; ``rows`` are those of one perturbation."""
    levels, successes = [row.level for row in rows], [row.outcome.success for row in rows]
    low, high = ([100 * success.interval[side] for success in successes] for side in (0, 1))
    axes.fill_between(levels, low, high, color=color, alpha=0.15, linewidth=0)
    _draw_line(axes, rows, [100 * success.fraction for success in successes], color)
    if any(row.outcome.regulation_matters for row in rows):
        ends = [row.outcome.success_at_plan_end for row in rows]
        fractions = [float("nan") if end is None else 100 * end.fraction for end in ends]
        axes.plot(levels, fractions, "--", color=color, linewidth=0.8)


def _draw_violation(axes: Axes, rows: Sequence[LevelRow], color: str) -> None:
    """Mean violation of one method against the level; ``rows`` are those of one perturbation."""
    means = [row.outcome.violation_mean for row in rows]
    _draw_line(axes, rows, [float("nan") if mean is None else mean for mean in means], color)


def _draw_line(axes: Axes, rows: Sequence[LevelRow], values: Sequence[float], color: str) -> None:
    levels, label = [row.level for row in rows], rows[0].outcome.name
    axes.plot(levels, values, color=color, linewidth=1.2, marker="o", markersize=2.5, label=label)


@dataclass(frozen=True)
class Metric:
    """What the panels show."""

    title: str  # of the axis
    limits: tuple[float, float | None]  # of the axis
    #: draws one method into axes, from its rows for one perturbation, in a colour
    draw: Callable[[Axes, Sequence[LevelRow], str], None]


SUCCESS = Metric("success, %", (-3, 103), _draw_success)
VIOLATION = Metric("mean violation, m", (0, None), _draw_violation)
