"""The figure of paths in the plane: samples by cluster.

It is that of Tang & Hauser (2019), section V-B (the ground vehicle), for any problem whose
:class:`~ocp_envs.picture.Picture` traces a path in the plane.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from moe_policy.experiments.figures.axes import INK, check_labels, coordinate_text
from moe_policy.experiments.figures.style import cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def samples_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, shown: int = 150, seed: int = 0
) -> Path:
    """Paths in the plane of at most ``shown`` samples, coloured by cluster; dots are initial positions."""
    check_labels(samples, labels, shown)
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
