"""Figures of any problem: state histories by cluster, and histograms of final errors."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from moe_policy.experiments.figures.axes import INK, check_labels, coordinate_text, label_state
from moe_policy.experiments.figures.style import COLORS, cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from ocp_envs.data.samples import Samples
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARGIN = 1.05
_SMALLEST_ERROR = 1e-6


def histories_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, shown: int = 40, seed: int = 0
) -> Path:
    """Histories of at most ``shown`` samples a cluster: a row for each coordinate, a column for each cluster."""
    check_labels(samples, labels, shown)
    problem, generator = samples.problem, np.random.default_rng(seed)
    chosen = [generator.permutation(np.flatnonzero(labels.values == i))[:shown] for i in range(labels.k)]

    def draw(figure: Figure) -> None:
        coordinates = problem.system.state.coordinates
        grid = figure.subplots(len(coordinates), labels.k, sharex=True, sharey="row", squeeze=False)
        for i, rows in enumerate(chosen):
            batch = samples.trajectory[rows]
            for axes, states in zip(grid[:, i], np.moveaxis(batch.states, 2, 0)):
                axes.plot(batch.times.T, states.T, color=cluster_color(i), linewidth=0.5, alpha=0.6)
            grid[0, i].set_title(
                f"{coordinate_text(labels.names[i])}\n({labels.sizes[i]:,})".replace(", ", "\n"), fontsize=8
            )
            grid[-1, i].set_xlabel("time, s")
        for j, coordinate in enumerate(coordinates):
            for target in np.unique(problem.targets[:, j]):
                for axes in grid[j]:
                    axes.axhline(target, color=INK, linestyle=":", linewidth=0.8)
            label_state(grid[j, 0], coordinate)

    return save_figure(path, (1.2 + 1.4 * labels.k, 0.8 + 1.4 * problem.system.nx), draw)


def error_histograms_figure(
    path: str | os.PathLike[str], errors: Mapping[str, tuple[Array, Array]], radius: float, bins: int = 50
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
    for name, (predicted, tracked) in errors.items():
        if np.ndim(predicted) != 1 or np.shape(predicted) != np.shape(tracked):
            raise ValueError(f"{name}: expected two errors (B,), got {np.shape(predicted)} and {np.shape(tracked)}")
    values = np.concatenate([np.asarray(p, np.float64) for pair in errors.values() for p in pair] or [np.empty(0)])
    values = np.maximum(values[np.isfinite(values)], _SMALLEST_ERROR)
    if not len(values):
        raise ValueError("expected at least one finite error, got none")
    return np.geomspace(min(values.min(), radius) / _MARGIN, max(values.max(), radius) * _MARGIN, bins + 1)
