"""Figures of paths in the plane: samples by cluster, and a state where a single network averages over families.

They are those of Tang & Hauser (2019), section V-B (the ground vehicle), for any problem whose
:class:`~ocp_envs.picture.Picture` traces a path in the plane.
"""

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
    save_figure,
)
from moe_policy.learning.clustering import Labels
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.protocols import Planner
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: Dark, to contrast with the thin lines in the colours of the clusters.
_PLAN_COLORS = ("#c1121f", "#3d1a8a", "#5c4400", "#0b5d3b")
_PLAN_DASHES = ((4, 1.5), (1.5, 1.2), (6, 1.5, 1.5, 1.5), (3, 3))


def plane_path(problem: OptimalControlProblem, states: Array) -> Array:
    """The path of ``states`` (N, nx) in the plane, (2, N)."""
    if problem.picture is None or len(problem.picture.limits) != 2:
        raise ValueError(f"{problem.id}: expected a problem with a picture in the plane; use histories_figure instead")
    return problem.picture.path(states).T


def finish_plane(axes: Axes, problem: OptimalControlProblem) -> None:
    """Draw the goal as a black circle; axes of equal scale."""
    goal = plane_path(problem, problem.goal.state[None])
    axes.plot(*goal, "o", color=INK, markersize=7, zorder=5, label="goal")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x, m", ylabel="y, m")


def samples_figure(path: str | Path, samples: Samples, labels: Labels, shown: int = 150, seed: int = 0) -> Path:
    """Paths in the plane of at most ``shown`` samples, coloured by cluster; dots are initial positions."""
    problem = samples.problem
    plane_path(problem, problem.goal.state[None])
    rows = np.random.default_rng(seed).permutation(len(labels))[:shown]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row in rows:
            color = cluster_color(int(labels.values[row]))
            x, y = plane_path(problem, samples.trajectory.states[row])
            axes.plot(x, y, color=color, linewidth=0.9, alpha=0.8)
            axes.plot(x[0], y[0], "o", color=color, markersize=3)
        for i, (name, size) in enumerate(zip(labels.names, labels.sizes)):
            axes.plot([], [], color=cluster_color(i), label=f"{coordinate_text(name)} ({size:,})")
        finish_plane(axes, problem)
        figure.legend(loc="outside right center", title="cluster (samples)")

    return save_figure(path, (7.4, 5.0), draw)


def winding_coordinate(problem: OptimalControlProblem) -> int:
    """The state coordinate that distinguishes the windings of the goal.

    The first one in which the goal states differ; without windings the first periodic one, or else the first.
    """
    winding = np.ptp(problem.targets, axis=0) > 0
    periodic = problem.system.state.periods > 0
    return int(np.argmax(winding if winding.any() else periodic))


def choose_interpolated(validation: Samples, snn: Planner, moe: Planner, training: Samples, k: int = 8) -> int:
    """The row of ``validation`` that best shows how a single network averages over families of optimal trajectories.

    A case shows it if the mixture's plan ends at the end of the optimal one (within the radius of the goal ball, with
    the same winding), the ``k`` nearest training samples belong to at least two families, and the plan of the single
    network ends between two goal states and farther than the radius from both, in the coordinate that distinguishes
    windings. Cases with neighbours of three or more families come first, then the one farthest from every goal state.
    If no case satisfies all conditions, the same order without them decides; of equal cases the first is chosen.
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


def interpolation_figure(
    path: str | Path,
    optimal: Trajectory,
    neighbours: Samples,
    predictions: Mapping[str, Trajectory],
    problem: OptimalControlProblem,
) -> Path:
    """Predictions from one initial state and the optimal trajectories of its neighbours, in the plane and over time.

    Neighbours are coloured by their solution family, predictions dashed; all plans are batches of one. The right panel
    shows the coordinate that distinguishes the windings.
    """
    plane_path(problem, problem.goal.state[None])
    index = winding_coordinate(problem)

    def draw(figure: Figure) -> None:
        plane, history = figure.subplots(1, 2)
        for plan, style in _lines(optimal, neighbours, predictions):
            x, y = plane_path(problem, plan.states[0])
            plane.plot(x, y, **style)
            plane.plot(x[0], y[0], "o", color=style["color"], markersize=3, zorder=style["zorder"])
            history.plot(plan.times[0], plan.states[0, :, index], **style)
            history.plot(plan.times[0, -1], plan.states[0, -1, index], "o", color=style["color"], markersize=3)
        history.plot([], [], " ", label="neighbours by family:")
        for mode, count in zip(*np.unique(neighbours.mode, return_counts=True)):
            name = f"{coordinate_text(problem.modes.names[mode])} ({count})"
            history.plot([], [], color=cluster_color(int(mode)), linewidth=1.0, label=name)
        finish_plane(plane, problem)
        for target in problem.targets[:, index]:
            history.axhline(target, color=INK, linestyle=":", linewidth=1.0, zorder=1)
        history.set_xlabel("time, s")
        label_state(history, problem.system.state.coordinates[index])
        handles, names = history.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside right center")

    return save_figure(path, (10.0, 3.8), draw)


def _lines(
    optimal: Trajectory, neighbours: Samples, predictions: Mapping[str, Trajectory]
) -> list[tuple[Trajectory, dict[str, object]]]:
    """Trajectories of one and their look: neighbours thin, the optimum black, predictions dashed."""
    thin = {"linewidth": 1.0, "alpha": 0.75, "zorder": 2}
    lines: list[tuple[Trajectory, dict[str, object]]] = [
        (neighbours.trajectory[i], {"color": cluster_color(int(mode)), **thin})
        for i, mode in enumerate(neighbours.mode)
    ]
    lines.append((optimal, {"color": INK, "linewidth": 2.2, "zorder": 3, "label": "optimal"}))
    for (name, plan), color, dashes in zip(predictions.items(), _PLAN_COLORS, _PLAN_DASHES):
        lines.append((plan, {"color": color, "dashes": dashes, "linewidth": 2.2, "zorder": 4, "label": name}))
    return lines
