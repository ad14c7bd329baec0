"""Figures of clusters: in the phase plane, over the box of two parameters, and over time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from moe_policy.experiments.figures.style import (
    INK,
    Axes,
    Figure,
    cluster_color,
    coordinate_text,
    label_state,
    looks,
    save_figure,
)
from moe_policy.learning.clustering import Labels
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.trajectory import Trajectory


def _phase_labels(axes: Axes, problem: OptimalControlProblem) -> None:
    for coordinate, setter in zip(problem.system.state.coordinates[:2], (axes.set_xlabel, axes.set_ylabel)):
        setter(f"{coordinate_text(coordinate.name)}, {coordinate.unit}")
    axes.plot(*problem.targets[:, :2].T, "o", color="#d62728", markersize=5, zorder=3)


def discontinuity_figure(
    path: str | Path,
    samples: Samples,
    labels: Labels,
    optimal: Trajectory,
    predictions: Mapping[str, Trajectory],
    shown: int = 60,
    seed: int = 0,
) -> Path:
    """The paper's first figure, in the plane of the first two state coordinates.

    Above: ``shown`` samples and the prediction of the first model at one state. Below: the samples by cluster and the
    prediction of the second. The goal states are red. All plans are batches of one.
    """
    problem = samples.problem
    rows = np.random.default_rng(seed).permutation(len(samples.parameters))[:shown]

    def draw(figure: Figure) -> None:
        axes = figure.subplots(2, 2, sharex=True, sharey=True)
        for row in rows:
            states = samples.trajectory.states[row]
            color = cluster_color(labels.values[row])
            axes[0, 0].plot(states[:, 0], states[:, 1], color="#555555", linewidth=0.6)
            axes[1, 0].plot(states[:, 0], states[:, 1], color=color, linewidth=0.6)
        axes[0, 0].set_title("optimal trajectories")
        axes[1, 0].set_title("the same by cluster")
        for ax, (name, plan) in zip(axes[:, 1], predictions.items()):
            colors = {key: look["color"] for key, look in looks(["optimal", name]).items()}
            ax.plot(optimal.states[0, :, 0], optimal.states[0, :, 1], color=colors["optimal"], label="optimal")
            ax.plot(plan.states[0, :, 0], plan.states[0, :, 1], "--", color=colors[name], label=name)
            ax.set_title(f"prediction of {name} near the discontinuity")
            ax.legend(loc="best", fontsize=8)
        for ax in axes.ravel():
            _phase_labels(ax, problem)

    return save_figure(path, (9.0, 6.5), draw)


def clusters_figure(path: str | Path, samples: Samples, partitions: Mapping[str, Labels]) -> Path:
    """Clusters over the box of the first two parameters, one panel per partition."""
    p, box = samples.parameters, samples.problem.parameters

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(partitions), sharex=True, sharey=True, squeeze=False)[0]
        for ax, (name, labels) in zip(axes, partitions.items()):
            colors = [cluster_color(value) for value in labels.values]
            ax.scatter(p[:, 0], p[:, 1], c=colors, s=6, linewidths=0)
            ax.set_title(f"{name}: {', '.join(str(size) for size in labels.sizes)}", fontsize=7)
            ax.set_xlabel(f"{coordinate_text(box.names[0])}, {box.coordinates[0].unit}")
        axes[0].set_ylabel(f"{coordinate_text(box.names[1])}, {box.coordinates[1].unit}")

    return save_figure(path, (3.2 * len(partitions), 3.0), draw)


def histories_figure(path: str | Path, samples: Samples, labels: Labels, shown: int = 40, seed: int = 0) -> Path:
    """Histories of at most ``shown`` samples a cluster: a row for each coordinate, a column for each cluster."""
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
