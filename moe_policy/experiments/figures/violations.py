"""Figures of violations of the path constraint: their distributions, and what a margin costs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.comparison import MarginRow
from moe_policy.experiments.figures.style import COLORS, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def violations_figure(path: str | os.PathLike[str], violations: Mapping[str, ArrayLike], title: str) -> Path:
    """The fraction of cases whose violation at the knots, (B,) in metres, exceeds a bound; a line for each model."""
    if not 1 <= len(violations) <= len(COLORS):
        raise ValueError(f"expected 1 to {len(COLORS)} models, got {list(violations)}")
    values = {name: np.sort(np.asarray(part, np.float64), axis=None) for name, part in violations.items()}
    for name, part in values.items():
        if np.ndim(violations[name]) != 1 or not len(part):
            raise ValueError(f"{name}: expected violations (B,) of at least one case, got {np.shape(violations[name])}")
        if not (np.isfinite(part) & (part >= 0)).all():
            raise ValueError(f"{name}: expected violations that are finite and at least 0, got {part[[0, -1]]}")

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for (name, part), color in zip(values.items(), COLORS):
            bounds = np.concatenate([[0.0], part])
            beyond = 100 * (1 - np.arange(len(part) + 1) / len(part))
            axes.step(bounds, beyond, where="post", color=color, label=f"{name}: mean {part.mean():.3f} m")
        axes.margins(x=0.015)
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(100 * 0.7 / max(map(len, values.values())), 130)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set(xlabel="violation at the knots, m", ylabel="cases with a larger violation, %", title=title)
        axes.legend()

    return save_figure(path, (5.6, 3.6), draw)


def margins_figure(path: str | os.PathLike[str], rows: Sequence[MarginRow]) -> Path:
    """Mean violation at the knots against the cost, along margins: a curve for each planner, a star for the optimum."""
    curves: dict[str, list[MarginRow]] = {}
    for row in rows:
        curves.setdefault(row.row.name, []).append(row)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        colors = iter(COLORS)
        for name, curve in curves.items():
            optimum = curve[0].margin is None
            metrics = [row.row.metrics for row in curve]
            cost = [100 * ((m.relative_cost or np.nan) - 1) for m in metrics]
            violation = [np.nan if m.knot_violation_mean is None else m.knot_violation_mean for m in metrics]
            form, color, size = ("*", "black", 9) if optimum else ("o-", next(colors), 4)
            axes.plot(cost, violation, form, color=color, label=name, markersize=size)
            for row, x, y in zip(curve, cost, violation):
                if row.margin is not None:
                    text = f"{row.margin:g}"
                    axes.annotate(text, (x, y), xytext=(3, 3), textcoords="offset points", fontsize=7, color=color)
        axes.set(xlabel="cost above the tracked optimum, %", ylabel="mean violation at the knots, m")
        axes.set_ylim(bottom=0.0)
        axes.set_title("margins on the radius, m")
        axes.legend()

    return save_figure(path, (5.6, 3.8), draw)
