"""Figures of trajectories: samples by cluster, a state between families, histories by cluster, errors of the end.

They are those of Tang & Hauser (2019), section V-B (figures of the ground vehicle), for any problem whose
:class:`~ocp_envs.picture.Picture` traces a path in the plane; the histories and the histograms need no picture.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.experiments.figures.style import COLORS, cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.protocols import Planner
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Coordinate
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_INK = "#000000"
#: Dark, so that they stand out from the thin lines in the colours of the clusters.
_PLAN_COLORS = ("#c1121f", "#3d1a8a", "#5c4400", "#0b5d3b")
_PLAN_DASHES = ((4, 1.5), (1.5, 1.2), (6, 1.5, 1.5, 1.5), (3, 3))
_MARGIN = 1.05
_SMALLEST_ERROR = 1e-6
_GREEK = {"theta": "θ", "omega": "ω", "phi": "φ", "psi": "ψ", "pi": "π"}


# -- shared parts ------------------------------------------------------------------------------------------------------


def _text(name: str) -> str:
    """``theta_f = -2 pi, backwards`` → ``θ_f = −2π, backwards``, with the index set as one."""
    text = re.sub("[a-z]+", lambda word: _GREEK.get(word[0], word[0]), name)
    text = re.sub(r"\b(\w)_(\w)\b", r"$\1_\2$", text)
    text = re.sub(r"(\d) π", r"\1π", text).replace(" 0π", " 0")
    return re.sub(r"-(?=[\dπ])", "−", text)


def _label_state(axes: Axes, coordinate: Coordinate) -> None:
    """Name the state coordinate along y; angles are divided into multiples of π within what is already drawn."""
    axes.set_ylabel(_text(coordinate.name) + ("" if coordinate.unit == "1" else f", {coordinate.unit}"))
    if coordinate.period is not None and np.isclose(coordinate.period, 2 * np.pi):
        low, high = axes.get_ylim()
        half_turns = np.arange(np.ceil(low / np.pi), np.floor(high / np.pi) + 1)
        short = {-1: "−π", 0: "0", 1: "π"}
        names = [short.get(int(count), _text(f"{count:.0f} pi")) for count in half_turns]
        axes.set_yticks(half_turns * np.pi, names)


def _plane_path(problem: OptimalControlProblem, states: Array) -> Array:
    """The path of ``states`` (N, nx) in the plane, (2, N)."""
    if problem.picture is None or len(problem.picture.limits) != 2:
        raise ValueError(f"{problem.id}: expected a problem with a picture in the plane; use histories_figure instead")
    return problem.picture.path(states).T


def _finish_plane(axes: Axes, problem: OptimalControlProblem) -> None:
    """The goal as a black circle, axes of equal scale."""
    goal = _plane_path(problem, problem.goal.state[None])
    axes.plot(*goal, "o", color=_INK, markersize=7, zorder=5, label="goal")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x, m", ylabel="y, m")


def _check_labels(samples: Samples, labels: Labels, shown: int) -> None:
    if len(labels) != len(samples.parameters):
        raise ValueError(f"expected a label for each of {len(samples.parameters)} samples, got {len(labels)}")
    if shown < 1:
        raise ValueError(f"shown must be at least 1, got {shown}")


def winding_coordinate(problem: OptimalControlProblem) -> int:
    """The state coordinate that tells the windings of the goal apart.

    The first one in which the goal states differ; without windings the first periodic one, or else the first.
    """
    winding = np.ptp(problem.targets, axis=0) > 0
    periodic = problem.system.state.periods > 0
    return int(np.argmax(winding if winding.any() else periodic))


# -- which state to show -----------------------------------------------------------------------------------------------


def choose_interpolated(validation: Samples, snn: Planner, moe: Planner, training: Samples, k: int = 8) -> int:
    """The validation case that shows best how a single network averages over families of optimal trajectories.

    A case shows it if the mixture's plan ends where the optimal one does (within the radius of the goal ball, turns not
    counting as equal), the ``k`` nearest training samples belong to two modes at least, and the plan of the single
    network ends between two goal states and farther than the radius from both, in the coordinate that tells windings
    apart. Among these, one with neighbours of three modes or more goes first, then the one farthest from every goal
    state. Where no case shows all of that, the same order without the conditions decides; ties go to the first case.

    Args:
        validation: cases to choose from.
        snn: the single network.
        moe: the mixture.
        training: what the neighbours are taken from, by the distance of
        :class:`~moe_policy.planners.nearest.NearestPlanner`.
        k: number of neighbours.

    Returns:
        The case's row in ``validation``.
    """
    problem, p = validation.problem, validation.parameters
    around = np.sort(training.mode[NearestPlanner(training).neighbours(p, k)], axis=1)
    modes = np.minimum(1 + (np.diff(around, axis=1) != 0).sum(axis=1), 3)

    ends = moe(p).states[:, -1]
    close = np.linalg.norm(ends - validation.trajectory.states[:, -1], axis=1) < problem.goal.radius

    coordinate = winding_coordinate(problem)
    targets = problem.targets[:, coordinate]
    reached = snn(p).states[:, -1, coordinate]
    distance = np.abs(reached[:, None] - targets).min(axis=1)
    # Beyond the outermost goal state, and where it is not finite, a plan does not average over families.
    distance = np.where((reached > targets.min()) & (reached < targets.max()), distance, -1.0)
    shows = close & (modes >= 2) & (distance > problem.goal.radius)
    # The last key counts most; the first one lets the first of equal cases win.
    return int(np.lexsort((-np.arange(len(p)), distance, modes, close, shows))[-1])


# -- the figures -------------------------------------------------------------------------------------------------------


def samples_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, shown: int = 150, seed: int = 0
) -> Path:
    """Paths in the plane of a random selection of samples, coloured by cluster; a dot at each start.

    Args:
        path: file to write.
        samples: solved problems.
        labels: their clusters.
        shown: number of samples drawn, at most.
        seed: of their choice.
    """
    _check_labels(samples, labels, shown)
    problem = samples.problem
    _plane_path(problem, problem.goal.state[None])
    rows = np.random.default_rng(seed).permutation(len(labels))[:shown]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row in rows:
            color = cluster_color(int(labels.values[row]))
            x, y = _plane_path(problem, samples.trajectory.states[row])
            axes.plot(x, y, color=color, linewidth=0.9, alpha=0.8)
            axes.plot(x[0], y[0], "o", color=color, markersize=3)
        for i, (name, size) in enumerate(zip(labels.names, labels.sizes)):
            axes.plot([], [], color=cluster_color(i), label=f"{_text(name)} ({size:,})")
        _finish_plane(axes, problem)
        figure.legend(loc="outside right center", title="cluster (samples)")

    return save_figure(path, (7.4, 5.0), draw)


def interpolation_figure(
    path: str | os.PathLike[str],
    optimal: Trajectory,
    neighbours: Samples,
    predictions: Mapping[str, Trajectory],
    problem: OptimalControlProblem,
) -> Path:
    """Predictions from one state among the optimal trajectories of its neighbours: in the plane, and over time.

    Args:
        path: file to write.
        optimal: the optimal trajectory from the state, a batch of one.
        neighbours: the nearest training samples, coloured by their mode.
        predictions: plans from the state by name, batches of one; dashed.
        problem: whose trajectories they are. The right panel shows the coordinate that tells its windings apart.

    Raises:
        ValueError: a batch of another size, or a problem without a picture in the plane.
    """
    plans = {"optimal": optimal, **predictions}
    if wrong := {name: len(plan) for name, plan in plans.items() if len(plan) != 1}:
        raise ValueError(f"expected batches of one trajectory, got {wrong}")
    if len(plans) > 1 + len(_PLAN_COLORS):
        raise ValueError(f"expected at most {len(_PLAN_COLORS)} predictions, got {list(predictions)}")
    _plane_path(problem, problem.goal.state[None])
    index = winding_coordinate(problem)

    def draw(figure: Figure) -> None:
        plane, history = figure.subplots(1, 2)
        lines: list[tuple[Trajectory, dict[str, Any]]] = [
            (
                neighbours.trajectory[i],
                {"color": cluster_color(int(mode)), "linewidth": 1.0, "alpha": 0.75, "zorder": 2},
            )
            for i, mode in enumerate(neighbours.mode)
        ]
        lines.append((optimal, {"color": _INK, "linewidth": 2.2, "zorder": 3, "label": "optimal"}))
        for i, (name, plan) in enumerate(predictions.items()):
            style = {"color": _PLAN_COLORS[i], "dashes": _PLAN_DASHES[i], "linewidth": 2.2, "zorder": 4}
            lines.append((plan, style | {"label": name}))
        for plan, style in lines:
            x, y = _plane_path(problem, plan.states[0])
            plane.plot(x, y, **style)
            plane.plot(x[0], y[0], "o", color=style["color"], markersize=3, zorder=style["zorder"])
            history.plot(plan.times[0], plan.states[0, :, index], **style)
            history.plot(plan.times[0, -1], plan.states[0, -1, index], "o", color=style["color"], markersize=3)
        history.plot([], [], " ", label="neighbours by mode:")
        for mode, count in zip(*np.unique(neighbours.mode, return_counts=True)):
            name = f"{_text(problem.modes.names[mode])} ({count})"
            history.plot([], [], color=cluster_color(int(mode)), linewidth=1.0, label=name)
        _finish_plane(plane, problem)
        for target in problem.targets[:, index]:
            history.axhline(target, color=_INK, linestyle=":", linewidth=1.0, zorder=1)
        history.set_xlabel("time, s")
        _label_state(history, problem.system.state.coordinates[index])
        handles, names = history.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside right center")

    return save_figure(path, (10.0, 3.8), draw)


def histories_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, shown: int = 40, seed: int = 0
) -> Path:
    """Histories of the state over time: a row for each coordinate, a column for each cluster.

    Args:
        path: file to write.
        samples: solved problems.
        labels: their clusters.
        shown: number of samples drawn of each cluster, at most.
        seed: of their choice.
    """
    _check_labels(samples, labels, shown)
    problem, generator = samples.problem, np.random.default_rng(seed)
    chosen = [generator.permutation(np.flatnonzero(labels.values == i))[:shown] for i in range(labels.k)]

    def draw(figure: Figure) -> None:
        coordinates = problem.system.state.coordinates
        grid = figure.subplots(len(coordinates), labels.k, sharex=True, sharey="row", squeeze=False)
        for i, rows in enumerate(chosen):
            batch = samples.trajectory[rows]
            for axes, states in zip(grid[:, i], np.moveaxis(batch.states, 2, 0)):
                axes.plot(batch.times.T, states.T, color=cluster_color(i), linewidth=0.5, alpha=0.6)
            grid[0, i].set_title(f"{_text(labels.names[i])}\n({labels.sizes[i]:,})".replace(", ", "\n"), fontsize=8)
            grid[-1, i].set_xlabel("time, s")
        for j, coordinate in enumerate(coordinates):
            for target in np.unique(problem.targets[:, j]):
                for axes in grid[j]:
                    axes.axhline(target, color=_INK, linestyle=":", linewidth=0.8)
            _label_state(grid[j, 0], coordinate)

    return save_figure(path, (1.2 + 1.4 * labels.k, 0.8 + 1.4 * problem.system.nx), draw)


def error_histograms_figure(
    path: str | os.PathLike[str], errors: Mapping[str, tuple[Array, Array]], radius: float, bins: int = 50
) -> Path:
    """Histograms of the predicted and of the tracked final error, one panel per model, over the same logarithmic bins.

    Args:
        path: file to write.
        errors: (error of the predicted final state, error of the tracked one) by model, each (B,). An error that is
            not finite counts as beyond the goal ball and is drawn in the last bin.
        radius: of the goal ball, drawn as a line; the titles count the errors that are not below it.
        bins: number of bins.

    Raises:
        ValueError: two errors of a model that are not of one shape (B,), or no finite error at all.
    """
    for name, (predicted, tracked) in errors.items():
        if np.ndim(predicted) != 1 or np.shape(predicted) != np.shape(tracked):
            raise ValueError(f"{name}: expected two errors (B,), got {np.shape(predicted)} and {np.shape(tracked)}")
    values = np.concatenate(
        [np.asarray(part, np.float64) for pair in errors.values() for part in pair] or [np.empty(0)]
    )
    values = np.maximum(values[np.isfinite(values)], _SMALLEST_ERROR)
    if not len(values):
        raise ValueError("expected at least one finite error, got none")
    low, high = min(values.min(), radius), max(values.max(), radius)
    edges = np.geomspace(low / _MARGIN, high * _MARGIN, bins + 1)

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
            axes.axvline(radius, color=_INK, linestyle="--", linewidth=1.0, label="goal ball")
            axes.set(xscale="log", xlabel="error of the final state")
            axes.set_title(f"{name}, {len(pair[0]):,} cases, beyond the goal ball:\n{', '.join(beyond)}", fontsize=9)
        panels[0].set_ylabel("cases")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")

    return save_figure(path, (1.2 + 4.0 * len(errors), 3.2), draw)
