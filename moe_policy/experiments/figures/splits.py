"""Methods against the distance from the discontinuity, and on every split, from a record of splits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from moe_policy.experiments.distances import DistanceCurves, measures_of
from moe_policy.experiments.figures.style import Axes, Figure, looks, save_figure
from moe_policy.experiments.splits import SPLITS, SplitComparison, SplitMethod
from moe_policy.rollouts.intervals import Estimate, Mean, Proportion
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import discontinuity_of

Look = Mapping[str, Any]

_MARKERS = dict(zip(SPLITS, "oDs"))


def splits_figure(path: str | Path, problem: OptimalControlProblem, record: SplitComparison) -> Path:
    """One row of panels for each measure of ``problem``.

    Left: the measure against the distance from the discontinuity, a curve for each method with its 95 % band; without a
    discontinuity this column is left out. Right: the measure on every split, with its 95 % interval.
    """
    measures, curves, discontinuity = measures_of(problem), record.curves, discontinuity_of(problem)
    names = [method.name for method in record.rows]
    styles = looks(names)

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(len(measures), 1 + (curves is not None), squeeze=False)
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


def _legends(figure: Figure, panels: Any) -> None:
    """Methods below all panels, splits in the first of their panels."""
    panels[0, -1].legend(fontsize=8, loc="best")
    if panels.shape[1] > 1:
        curves = {text: line for axes in panels[:, 0] for line, text in zip(*axes.get_legend_handles_labels())}
        figure.legend(curves.values(), curves.keys(), loc="outside lower center", ncols=len(curves), fontsize=8)
