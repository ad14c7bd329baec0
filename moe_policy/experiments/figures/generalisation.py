"""Figures of methods off the nominal instances: near the discontinuity, outside the box, and on perturbed plants."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from moe_policy.experiments.distances import DistanceCurves, measures_of
from moe_policy.experiments.figures.style import Axes, Figure, Panels, looks, save_figure
from moe_policy.experiments.perturbations import Perturbation
from moe_policy.experiments.robustness import LevelRow, Robustness
from moe_policy.experiments.splits import SplitComparison, SplitMethod
from moe_policy.rollouts.intervals import Estimate, Mean, Proportion
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import discontinuity_of
from ocp_envs.sets.reference import SPLITS

Look = Mapping[str, str]
_MARKERS = dict(zip(SPLITS, "oDvs"))
COLUMNS = 3
#: Levels from 0 whose maximum is more than so many times the minimum above 0 are drawn on a logarithmic axis.
_WIDE = 15


def splits_figure(path: str | Path, problem: OptimalControlProblem, record: SplitComparison) -> Path:
    """One row of panels for each measure of ``problem``.

    Left: the measure against the distance from the discontinuity, a curve for each method with its 95 % band; without a
    discontinuity this column is left out. Right: the measure on every split, with its 95 % interval.
    """
    measures, curves, discontinuity = measures_of(problem), record.curves, discontinuity_of(problem)
    names = [method.name for method in record.rows]
    styles = looks(names)

    def draw(figure: Figure) -> None:
        panels: Panels = figure.subplots(len(measures), 1 + (curves is not None), squeeze=False)
        for row, measure in zip(panels, measures):
            if curves is not None:
                draw_curves(row[0], curves, measure.name, styles)
                row[0].set(xlabel=discontinuity.label if discontinuity else "", ylabel=measure.label)
            draw_splits(row[-1], record.rows, measure.name, styles)
            row[-1].set_xlabel(measure.label)
        _legends(figure, panels)

    height = max(2.6, 1.2 + 0.3 * len(names))
    return save_figure(path, (6.5 if curves is None else 11.0, height * len(measures)), draw)


def draw_curves(axes: Axes, curves: DistanceCurves, measure: str, styles: Mapping[str, Look]) -> None:
    """Draw one measure of every method against the distance, with the band of its intervals."""
    drawn: list[Estimate] = []
    for name, bins in curves.metrics[measure].items():
        points = [(x, estimate) for x, estimate in zip(curves.distance, bins) if estimate is not None]
        if not points:
            continue
        x, estimates = zip(*points)
        middle, low, high = zip(*map(_values, estimates))
        axes.plot(x, middle, marker="o", markersize=3.5, label=name, **styles[name])
        axes.fill_between(x, low, high, color=styles[name]["color"], alpha=0.15, linewidth=0)
        drawn += estimates
    axes.set_xscale("log")
    axes.set_ylim(*_limits(drawn))


def draw_splits(axes: Axes, methods: Sequence[SplitMethod], measure: str, styles: Mapping[str, Look]) -> None:
    """Draw one measure of every method on every split, with its interval."""
    drawn: list[Estimate] = []
    there = [split for split in SPLITS if any(split in method.splits for method in methods)]
    for i, method in enumerate(methods):
        for j, split in enumerate(there):
            value = method.splits[split].judged[measure] if split in method.splits else None
            if value is None:
                continue
            middle, low, high = _values(value)
            y, color = i + 0.22 * (j - (len(there) - 1) / 2), styles[method.name]["color"]
            axes.plot([low, high], [y, y], color=color)
            axes.plot(middle, y, _MARKERS[split], color=color, markersize=4.5, markerfacecolor=color if j == 0 else "w")
            drawn.append(value)
    for j, split in enumerate(there):
        face = "#555555" if j == 0 else "w"
        axes.plot([], [], _MARKERS[split], color="#555555", markersize=4.5, markerfacecolor=face, label=split)
    axes.set_yticks(range(len(methods)), [method.name for method in methods])
    axes.set_ylim(len(methods) - 0.5, -0.5)
    axes.set_xlim(*_limits(drawn))


def _values(estimate: Estimate) -> tuple[float, float, float]:
    """Middle, lower and upper end: of a fraction in per cent, of a mean in its unit."""
    low, high = estimate.interval
    if isinstance(estimate, Mean):
        return estimate.mean, low, high
    assert isinstance(estimate, Proportion)
    return 100 * estimate.fraction, 100 * low, 100 * high


def _limits(drawn: Sequence[Estimate]) -> tuple[float | None, float | None]:
    """Fractions end at 100 %, means begin at 0."""
    return (None, 103) if drawn and isinstance(drawn[0], Proportion) else (0, None)


def _legends(figure: Figure, panels: Panels) -> None:
    """Methods below all panels, splits in the first of their panels."""
    panels[0, -1].legend(fontsize=8, loc="best")
    if panels.shape[1] > 1:
        curves = {text: line for axes in panels[:, 0] for line, text in zip(*axes.get_legend_handles_labels())}
        figure.legend(curves.values(), curves.keys(), loc="outside lower center", ncols=len(curves), fontsize=8)


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
    """A line with the ``values`` of ``rows``; a variant of a method, such as ``"snn, estimated"``, has open markers."""
    levels, label = [row.level for row in rows], rows[0].outcome.name
    face, size = ("w", 4.0) if ", " in label else (color, 2.5)
    axes.plot(levels, values, color=color, linewidth=1.2, marker="o", mfc=face, markersize=size, label=label)


@dataclass(frozen=True)
class Metric:
    """What the panels show."""

    title: str  # of the axis
    limits: tuple[float, float | None]  # of the axis
    #: draws one method into axes, from its rows for one perturbation, in a colour
    draw: Callable[[Axes, Sequence[LevelRow], str], None]


SUCCESS = Metric("success, %", (-3, 103), _draw_success)
VIOLATION = Metric("mean violation, m", (0, None), _draw_violation)


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
        panels: Panels = figure.subplots(lines * len(metrics), COLUMNS, squeeze=False)
        for metric, block in zip(metrics, panels.reshape(len(metrics), -1)):
            for axes, perturbation in zip(block, record.perturbations):
                draw_panel(axes, record, perturbation, metric)
            for axes in block[::COLUMNS]:
                axes.set_ylabel(metric.title)
            for axes in block[len(record.perturbations) :]:
                axes.set_axis_off()
        matters = any(row.outcome.regulation_matters for row in record.rows)
        title = "dashed: at the plan's end, before terminal regulation" if matters else None
        handles = panels[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=min(len(names), 8), title=title)

    return save_figure(path, (10.0, 0.8 + 2.6 * lines * len(metrics)), draw)


def draw_panel(axes: Axes, record: Robustness, perturbation: Perturbation, metric: Metric) -> None:
    """Draw ``metric`` of all methods in ``record`` against the level of ``perturbation``."""
    for name, look in looks(record.methods).items():
        if rows := record.rows_of(perturbation, name):
            metric.draw(axes, rows, look["color"])
    axes.set_ylim(*metric.limits)  # before the scale of x: the limits of x follow from the linear one
    levels = perturbation.levels
    if levels[0] == 0 and levels[-1] > _WIDE * levels[1]:
        axes.set_xscale("symlog", linthresh=levels[1])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(left=0)
    axes.set_xlabel(f"{perturbation.label}, {perturbation.unit}")
