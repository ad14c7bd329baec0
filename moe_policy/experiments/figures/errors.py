"""Figures of final errors and of violations of the path constraint."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.figures.style import COLORS, INK, Figure, looks, save_figure
from ocp_envs.support.arrays import Array

_MARGIN = 1.05
_SMALLEST_ERROR = 1e-6


def error_figure(path: str | Path, errors: Mapping[str, tuple[Array, Array]], radius: float) -> Path:
    """Error of the predicted final state against that after tracking and regulation, each (B,), a panel per model."""

    def draw(figure: Figure) -> None:
        columns = 3
        rows = -(-len(errors) // columns)
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for ax, (name, (predicted, tracked)) in zip(axes.ravel(), errors.items()):
            failed = ~(tracked < radius)
            for chosen, color in ((~failed, COLORS[0]), (failed, COLORS[1])):
                ax.plot(np.maximum(predicted[chosen], 1e-5), np.maximum(tracked[chosen], 1e-9), ".", color=color, ms=3)
            ax.axhline(radius, color="black", linestyle="--", linewidth=0.8)
            ax.set(xscale="log", yscale="log", title=f"{name}: {int(failed.sum())} failures")
        for ax in axes[-1]:
            ax.set_xlabel("error of the predicted end")
        for ax in axes[:, 0]:
            ax.set_ylabel("error after terminal regulation")

    return save_figure(path, (9.0, 2.4 * -(-len(errors) // 3)), draw)


def error_histograms_figure(
    path: str | Path, errors: Mapping[str, tuple[Array, Array]], radius: float, bins: int = 50
) -> Path:
    """Histograms of (predicted, tracked) final errors, one panel per model, over the same logarithmic bins.

    An error that is not finite counts as beyond the goal ball and is drawn in the last bin. The ``radius`` of the goal
    ball is a line; the titles count the errors that are not below it.
    """
    edges = _edges(errors, radius, bins)
    low, high = edges[0] * _MARGIN, edges[-1] / _MARGIN

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(errors), sharex=True, sharey=True, squeeze=False)[0]
        for axes, (name, pair) in zip(panels, errors.items()):
            beyond = []
            for part, kind, color in zip(map(np.asarray, pair), ("predicted", "tracked"), COLORS):
                drawn = np.clip(np.where(np.isfinite(part), part, high), low, high)
                axes.hist(drawn, edges, color=color, alpha=0.3)
                axes.hist(drawn, edges, color=color, histtype="step", linewidth=1.3)
                axes.plot([], [], color=color, label=kind)
                beyond.append(f"{kind} {int((~(part < radius)).sum()):,}")
            axes.axvline(radius, color=INK, linestyle="--", linewidth=1.0, label="goal ball")
            axes.set(xscale="log", xlabel="error of the final state")
            axes.set_title(f"{name}, {len(pair[0]):,} cases, beyond the goal ball:\n{', '.join(beyond)}", fontsize=9)
        panels[0].set_ylabel("cases")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")

    return save_figure(path, (1.2 + 4.0 * len(errors), 3.2), draw)


def _edges(errors: Mapping[str, tuple[Array, Array]], radius: float, bins: int) -> Array:
    """Logarithmic bins that contain all finite errors and the ``radius``."""
    values = np.concatenate([np.asarray(p, np.float64) for pair in errors.values() for p in pair] or [np.empty(0)])
    values = np.maximum(values[np.isfinite(values)], _SMALLEST_ERROR)
    if not len(values):
        raise ValueError("expected at least one finite error, got none")
    return np.geomspace(min(values.min(), radius) / _MARGIN, max(values.max(), radius) * _MARGIN, bins + 1)


def violations_figure(path: str | Path, violations: Mapping[str, ArrayLike], title: str) -> Path:
    """The fraction of cases whose violation at the knots, (B,) in metres, exceeds a bound, a line for each model."""
    if not 1 <= len(violations) <= len(COLORS):
        raise ValueError(f"expected 1 to {len(COLORS)} models, got {list(violations)}")
    values = {name: np.sort(np.asarray(part, np.float64), axis=None) for name, part in violations.items()}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for (name, part), look in zip(values.items(), looks(values).values()):
            bounds = np.concatenate([[0.0], part])
            beyond = 100 * (1 - np.arange(len(part) + 1) / len(part))
            axes.step(bounds, beyond, where="post", **look, label=f"{name}: mean {part.mean():.3f} m")
        axes.margins(x=0.015)
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(100 * 0.7 / max(map(len, values.values())), 130)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set(xlabel="violation at the knots, m", ylabel="cases with a larger violation, %", title=title)
        axes.legend()

    return save_figure(path, (5.6, 3.6), draw)
