"""Figures about learning: what the samples look like, where models fail, and how much data they need."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.experiments.figures.style import COLORS, cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _phase_labels(axes: Axes, problem: OptimalControlProblem) -> None:
    for coordinate, setter in zip(problem.system.state.coordinates[:2], (axes.set_xlabel, axes.set_ylabel)):
        setter(f"{coordinate.name}, {coordinate.unit}")
    axes.plot(*problem.targets[:, :2].T, "o", color="#d62728", markersize=5, zorder=3)


def discontinuity_figure(
    path: str | os.PathLike[str],
    samples: Samples,
    labels: Labels,
    optimal: Trajectory,
    predictions: Mapping[str, Trajectory],
    shown: int = 60,
    seed: int = 0,
) -> Path:
    """The paper's first figure, in the plane of the first two state coordinates.

    Above, a selection of samples and the prediction of the first model at one state; below, the samples by cluster and
    the prediction of the second. The goal states are red.

    Args:
        path: file to write.
        samples: the training samples.
        labels: their clusters.
        optimal: the optimal trajectory from the state, a batch of one.
        predictions: two models' plans from it, by name, batches of one.
        shown: number of samples drawn.
        seed: of their choice.
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
            ax.plot(optimal.states[0, :, 0], optimal.states[0, :, 1], color=COLORS[0], label="optimal")
            ax.plot(plan.states[0, :, 0], plan.states[0, :, 1], "--", color=COLORS[1], label=name)
            ax.set_title(f"prediction of {name} near the jump")
            ax.legend(loc="best", fontsize=8)
        for ax in axes.ravel():
            _phase_labels(ax, problem)

    return save_figure(path, (9.0, 6.5), draw)


def clusters_figure(path: str | os.PathLike[str], samples: Samples, partitions: Mapping[str, Labels]) -> Path:
    """Clusters over the box of the first two parameters, one panel per partition."""
    p, box = samples.parameters, samples.problem.parameters

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(partitions), sharex=True, sharey=True, squeeze=False)[0]
        for ax, (name, labels) in zip(axes, partitions.items()):
            colors = [cluster_color(value) for value in labels.values]
            ax.scatter(p[:, 0], p[:, 1], c=colors, s=6, linewidths=0)
            ax.set_title(f"{name}: {', '.join(str(size) for size in labels.sizes)}", fontsize=7)
            ax.set_xlabel(f"{box.names[0]}, {box.coordinates[0].unit}")
        axes[0].set_ylabel(f"{box.names[1]}, {box.coordinates[1].unit}")

    return save_figure(path, (3.2 * len(partitions), 3.0), draw)


def error_figure(path: str | os.PathLike[str], errors: Mapping[str, tuple[Array, Array]], radius: float) -> Path:
    """Prediction error of the plan's end against the state error after tracking and hold, one panel per model.

    Args:
        path: file to write.
        errors: (error of the predicted final state, error at the judging time) by model, each (B,).
        radius: of the goal ball, drawn as lines.
    """

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
            ax.set_ylabel("error after the hold")

    return save_figure(path, (9.0, 2.4 * -(-len(errors) // 3)), draw)


def sizes_figure(path: str | os.PathLike[str], rows: Sequence[Mapping[str, Any]], cases: int) -> Path:
    """What goes wrong against the number of training problems: median over seeds, and their range.

    Failures, or where there are path constraints, mean violations; on logarithmic scales, where no failure at all is
    drawn as half of one.

    Args:
        path: file to write.
        rows: records with ``name``, ``samples`` and lists over seeds: ``success`` and ``success_at_plan_end``, or
            ``knot_violation`` and ``violation`` in metres.
        cases: validation cases.
    """
    constrained = rows[0].get("violation", [None])[0] is not None
    shown = {"success": "after the hold", "success_at_plan_end": "at the plan's end"}
    if constrained:
        shown = {"knot_violation": "at the knots", "violation": "on the whole path"}
    elif all(row["success"] == row["success_at_plan_end"] for row in rows):  # a goal that cannot be held
        del shown["success"]

    def wrong(values: Sequence[float]) -> Array:
        return np.asarray(values, float) if constrained else np.maximum(cases - np.asarray(values), 0.5)

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
        for ax, (key, title) in zip(panels, shown.items()):
            for i, name in enumerate(dict.fromkeys(row["name"] for row in rows)):
                points = sorted((row["samples"], row[key]) for row in rows if row["name"] == name)
                counts = np.array([size for size, _ in points])
                values = np.array([np.quantile(wrong(v), [0, 0.5, 1]) for _, v in points])
                ax.fill_between(counts, values[:, 0], values[:, 2], color=COLORS[i], alpha=0.2, linewidth=0)
                ax.plot(counts, values[:, 1], "o-", color=COLORS[i], label=name, markersize=4)
            ax.set(xscale="log", yscale="log", xlabel="training problems", title=title)
            if constrained:  # hardly a decade: every number stands where it is
                ax.yaxis.set_major_formatter("{x:g}")
                ax.yaxis.set_minor_formatter("{x:g}")
        panels[0].set_ylabel("mean violation, m" if constrained else f"failures of {cases:,}")
        panels[0].legend()

    return save_figure(path, (8.0 if len(shown) == 2 else 4.5, 3.2), draw)


def mixture_figure(path: str | os.PathLike[str], experts: int = 3) -> Path:
    """A sketch of a mixture: the gate sees p and chooses the expert that plans; the paper's figure 2.

    Args:
        path: file to write.
        experts: number of experts, the second of which is chosen.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set(xlim=(0.2, 9.8), ylim=(-1.6, experts - 0.4), aspect="equal")
        axes.set_axis_off()

        def box(x: float, y: float, text: str, color: str) -> None:
            frame = {"boxstyle": "round,pad=0.5", "edgecolor": color, "facecolor": "white", "linewidth": 1.5}
            axes.text(x, y, text, ha="center", va="center", bbox=frame, fontsize=10)

        def arrow(start: tuple[float, float], end: tuple[float, float], color: str, **form: Any) -> None:
            axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": color, "linewidth": 1.5, **form})

        middle, chosen, below = (experts - 1) / 2, min(1, experts - 1), -1.1
        box(0.8, middle, "p", "black")
        box(4.9, below, "gate", COLORS[1])
        arrow((0.8, middle - 0.45), (4.3, below), "black", connectionstyle="angle,angleA=90,angleB=0")
        for i in range(experts):
            color = COLORS[0] if i == chosen else COLORS[7]
            box(4.9, i, f"expert {i + 1}", color)
            arrow((1.2, middle), (3.9, i), color)
        arrow((5.9, chosen), (8.4, chosen), COLORS[0])
        arrow((5.5, below), (7.1, chosen), COLORS[1], linestyle="--", connectionstyle="angle,angleA=0,angleB=90")
        axes.text(7.25, below / 2 + 0.2, "chooses", color=COLORS[1], fontsize=9)
        box(9.1, chosen, "plan", "black")

    return save_figure(path, (6.0, 1.2 + 0.7 * experts), draw)
