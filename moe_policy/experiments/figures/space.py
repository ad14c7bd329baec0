"""Figures of paths in space: samples by cluster, and samples around one instance.

They are those of Tang & Hauser (2019), section V-C (the quadcopter with a sphere), for any problem whose
:class:`~ocp_envs.picture.Picture` traces a path in space. Paths are smooth curves through their knots;
:mod:`ocp_envs.render.visibility` determines which parts are hidden behind spheres. A path that is not finite is left
out.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from moe_policy.experiments.figures.style import INK, Figure, cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from moe_policy.planners.nearest import NearestPlanner
from ocp_envs.data.samples import Samples
from ocp_envs.picture import Ball, Picture
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.space import Space
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

Size = tuple[float, float]
Bounds = tuple[float, float, float, float]
_SPHERE_COLOR, _SPHERE_ALPHA = "#9aa3ad", 0.42
_PIECES = 6  # of a curve between two knots
_ELEVATION, _TURN = 14.0, 12.0  # of the camera, degrees: above the horizon, and away from the exact side view


def picture_of(problem: OptimalControlProblem) -> Picture:
    """The picture of ``problem``; raises a ``ValueError`` where it is not one in space."""
    if problem.picture is None or problem.picture.dimensions != 3:
        raise ValueError(
            f"{problem.id}: expected a problem with a picture in space; figures in the plane are in plane.py"
        )
    return problem.picture


def cluster_text(name: str) -> str:
    """``-+-`` → ``(−, +, −)``; other names as they are."""
    return f"({', '.join(name)})".replace("-", "−") if re.fullmatch(r"[-+]+", name) else name


def spheres_of(problem: OptimalControlProblem, context: Array) -> list[Ball]:
    """The spheres of ``context`` (nc,), all in one colour."""
    shapes = picture_of(problem).shapes(problem.goal.state, context)
    found = [shape for shape in shapes if isinstance(shape, Ball)]
    return [dataclasses.replace(ball, color=_SPHERE_COLOR, alpha=_SPHERE_ALPHA) for ball in found]


def closeup(problem: OptimalControlProblem, plans: Trajectory, spheres: Sequence[Ball]) -> Picture:
    """The problem's picture in the smallest cube around paths, goal and spheres, seen from the side of the paths."""
    picture = picture_of(problem)
    goal = picture.trace(problem.goal.state[None])
    paths = np.stack([picture.trace(states) for states in plans.states[plans.finite]])
    balls = [ball.center + ball.radius * np.array([[-1], [1]]) for ball in spheres]
    extent = np.concatenate([goal, paths.reshape(-1, 3), *balls])
    middle, half = (extent.max(axis=0) + extent.min(axis=0)) / 2, 0.53 * np.ptp(extent, axis=0).max()
    x, y, _ = (paths[:, 0] - goal).mean(axis=0)
    view = _ELEVATION, float(np.degrees(np.arctan2(y, x))) - 90 - _TURN
    return dataclasses.replace(picture, limits=tuple((m - half, m + half) for m in middle), view=view)


def panel(figure: Figure, bounds: Bounds, picture: Picture, title: str = "") -> Space:
    """Axes in space at ``bounds``; without numbers where there is a title, that is with several panels."""
    space = Space(figure, bounds, picture)
    space.axes.patch.set_visible(False)  # labels reach beyond the axes
    space.axes.set_box_aspect((1, 1, 1), zoom=1.04)
    space.axes.set_anchor("S")
    if title:
        figure.text(bounds[0] + bounds[2] / 2, bounds[1] + bounds[3], title, ha="center", va="top", linespacing=1.4)
        for name, axis in zip("xyz", (space.axes.xaxis, space.axes.yaxis, space.axes.zaxis)):
            axis.set_ticklabels([])
            axis.set_label_text(name)
            axis.labelpad = -16
    return space


def draw_path(space: Space, picture: Picture, states: Array, color: object, width: float, alpha: float = 1.0) -> None:
    """The path of ``states`` (N, nx) with a dot at the initial position."""
    if not np.isfinite(states).all():
        return
    knots = np.arange(len(states))
    fine = np.linspace(0, knots[-1], _PIECES * knots[-1] + 1)
    path = CubicSpline(knots, picture.trace(states))(fine)
    space.curve("trail", color=color, lw=width, alpha=alpha, solid_capstyle="round").set(path)
    space.curve("trail", color=color, ls="none", marker="o", ms=2 + width, mew=0).set(path[:1])


def draw_goal(space: Space, picture: Picture, problem: OptimalControlProblem) -> None:
    """The goal as a black dot."""
    goal = picture.trace(problem.goal.state[None])
    space.curve("body", color=INK, ls="none", marker="o", ms=4).set(goal)


def grid(count: int, widest: int, width: float, height: float, right: float = 0.0) -> tuple[Size, list[Bounds]]:
    """Size of a figure, and the bounds of ``count`` panels of ``width`` and ``height`` in it; lengths in inches.

    A row has at most ``widest`` panels; next to them a strip of the width ``right`` stays free.
    """
    rows = -(-count // widest)
    columns = -(-count // rows)
    size = columns * width + right, rows * height
    places = [divmod(i, columns) for i in range(count)]
    return size, [
        (column * width / size[0], 1 - (row + 1) / rows, width / size[0], 0.98 / rows) for row, column in places
    ]


def samples_figure(path: str | Path, samples: Samples, labels: Labels, shown: int = 25, seed: int = 0) -> Path:
    """Paths in space of at most ``shown`` samples a cluster, a panel for each cluster; dots are initial positions.

    Spheres are not drawn, as each sample has its own.
    """
    problem, generator = samples.problem, np.random.default_rng(seed)
    picture = picture_of(problem)
    chosen = [generator.permutation(np.flatnonzero(labels.values == i))[:shown] for i in range(labels.k)]
    size, bounds = grid(labels.k, 5, 2.2, 2.35, right=0.1)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")  # the panels have their places
        for i, rows in enumerate(chosen):
            space = panel(figure, bounds[i], picture, f"{cluster_text(labels.names[i])}: {labels.sizes[i]:,}")
            for row in rows:
                draw_path(space, picture, samples.trajectory.states[row], cluster_color(i), 0.8, 0.8)
            draw_goal(space, picture, problem)

    return save_figure(path, size, draw)


def around_figure(path: str | Path, samples: Samples, labels: Labels, parameters: ArrayLike, count: int = 40) -> Path:
    """Optimal paths, by cluster, of ``count`` samples nearest to ``parameters`` (np,), around the sphere of that p."""
    problem = samples.problem
    picture_of(problem)
    p = problem.check_parameters(parameters, extrapolate=True)
    if len(p) != 1:
        raise ValueError(f"expected one parameter ({len(problem.parameters)},), got {np.shape(parameters)}")
    rows = NearestPlanner(samples).neighbours(p, count)[0]
    spheres = spheres_of(problem, problem.start(p)[1][0])
    picture = closeup(problem, samples.trajectory[rows], spheres)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        space = panel(figure, (0.0, 0.0, 0.74, 1.08), picture)  # nothing is drawn in the upper part
        space.show(spheres)
        for row, cluster in zip(rows, labels.values[rows]):
            draw_path(space, picture, samples.trajectory.states[row], cluster_color(cluster), 1.3, 0.9)
        draw_goal(space, picture, problem)
        for i, number in zip(*np.unique(labels.values[rows], return_counts=True)):
            space.axes.plot([], [], [], color=cluster_color(i), label=f"{cluster_text(labels.names[i])}: {number}")
        handles = space.axes.get_legend_handles_labels()
        figure.legend(*handles, loc="center left", bbox_to_anchor=(0.77, 0.5), title="cluster: samples")

    return save_figure(path, (6.8, 4.6), draw)
