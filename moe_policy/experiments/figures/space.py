"""Figures of paths in space: samples by cluster, samples around one problem, a flip of the optimum, violations.

They are those of Tang & Hauser (2019), section V-C (the quadcopter round a sphere), for any problem whose
:class:`~ocp_envs.picture.Picture` traces a path in space. Paths are drawn as smooth curves through their knots and pass
behind spheres as :mod:`ocp_envs.render.visibility` works it out; a path that is not finite is left out.
"""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from moe_policy.experiments.comparison import MarginRow
from moe_policy.experiments.figures.cases import find_discontinuity, plan_violations
from moe_policy.experiments.figures.style import COLORS, cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from moe_policy.planners.nearest import NearestPlanner
from ocp_envs.data.samples import Samples
from ocp_envs.picture import Ball, Picture
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.space import Space
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Size = tuple[float, float]
Bounds = tuple[float, float, float, float]

_INK = "#000000"
_SPHERE: dict[str, Any] = {"color": "#9aa3ad", "alpha": 0.42}
_PIECES = 6  # of a curve between two knots
_ELEVATION, _TURN = 14.0, 12.0  # of the camera, degrees: above the horizon, and away from a view right from the side
_COLORS_OF_PROGRESS = "plasma", 0.02, 0.82  # the rest of the map is too light


# -- shared parts ------------------------------------------------------------------------------------------------------


def _picture_of(problem: OptimalControlProblem) -> Picture:
    if problem.picture is None or problem.picture.dimensions != 3:
        raise ValueError(
            f"{problem.id}: expected a problem with a picture in space; figures in the plane are elsewhere"
        )
    return problem.picture


def _check_labels(samples: Samples, labels: Labels) -> None:
    if len(labels) != len(samples.parameters):
        raise ValueError(f"expected a label for each of {len(samples.parameters)} samples, got {len(labels)}")


def _text(name: str) -> str:
    """``-+-`` → ``(−, +, −)``; other names as they are."""
    return f"({', '.join(name)})".replace("-", "−") if re.fullmatch(r"[-+]+", name) else name


def _spheres(problem: OptimalControlProblem, context: Array) -> list[Ball]:
    """The spheres that stand in ``context`` (nc,), all in one colour."""
    shapes = _picture_of(problem).shapes(problem.goal.state, context)
    found = [shape for shape in shapes if isinstance(shape, Ball)]
    return [dataclasses.replace(ball, **_SPHERE) for ball in found]


def _closeup(problem: OptimalControlProblem, plans: Trajectory, spheres: Sequence[Ball]) -> Picture:
    """The problem's picture in the smallest cube round paths, goal and spheres, seen from beside the paths."""
    picture = _picture_of(problem)
    goal = picture.trace(problem.goal.state[None])
    paths = np.stack([picture.trace(states) for states in plans.states[plans.finite]])
    balls = [ball.center + ball.radius * np.array([[-1], [1]]) for ball in spheres]
    extent = np.concatenate([goal, paths.reshape(-1, 3), *balls])
    middle, half = (extent.max(axis=0) + extent.min(axis=0)) / 2, 0.53 * np.ptp(extent, axis=0).max()
    x, y, _ = (paths[:, 0] - goal).mean(axis=0)
    view = _ELEVATION, float(np.degrees(np.arctan2(y, x))) - 90 - _TURN
    return dataclasses.replace(picture, limits=tuple((m - half, m + half) for m in middle), view=view)


def _panel(figure: Figure, bounds: Bounds, picture: Picture, title: str = "") -> Space:
    """Axes in space, without numbers where there is a title, that is where there are several panels."""
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


def _draw_path(space: Space, picture: Picture, states: Array, color: Any, width: float, alpha: float = 1.0) -> None:
    """The path of ``states`` (N, nx) with a dot at its start."""
    if not np.isfinite(states).all():
        return
    knots = np.arange(len(states))
    fine = np.linspace(0, knots[-1], _PIECES * knots[-1] + 1)
    path = CubicSpline(knots, picture.trace(states))(fine)
    space.curve("trail", color=color, lw=width, alpha=alpha, solid_capstyle="round").set(path)
    space.curve("trail", color=color, ls="none", marker="o", ms=2 + width, mew=0).set(path[:1])


def _draw_goal(space: Space, picture: Picture, problem: OptimalControlProblem) -> None:
    goal = picture.trace(problem.goal.state[None])
    space.curve("body", color=_INK, ls="none", marker="o", ms=4).set(goal)


def _draw_scale(axes: Axes, texts: Sequence[str], flip: int) -> Array:
    """A scale of colours from first to last, upwards, with a line after number ``flip``; returns them, (K, 4)."""
    from matplotlib import colormaps

    name, first, last = _COLORS_OF_PROGRESS
    colors = np.asarray(colormaps[name](np.linspace(first, last, len(texts))))
    axes.imshow(colors[:, None], origin="lower", aspect="auto")
    axes.axhline(flip + 0.5, color=_INK, linewidth=2)
    axes.grid(False)
    axes.spines[:].set_visible(False)
    shown = slice(None, None, -(-len(texts) // 12))
    axes.set_xticks([])
    axes.set_yticks(range(len(texts))[shown], texts[shown])
    axes.yaxis.tick_right()
    return colors


def _grid(count: int, widest: int, width: float, height: float, right: float = 0.0) -> tuple[Size, list[Bounds]]:
    """Size of a figure, and the bounds of ``count`` panels of ``width`` and ``height`` in it; lengths in inches.

    At most ``widest`` panels stand in a row; beside them there is room of the width ``right``.
    """
    rows = -(-count // widest)
    columns = -(-count // rows)
    size = columns * width + right, rows * height
    places = [divmod(i, columns) for i in range(count)]
    return size, [
        (column * width / size[0], 1 - (row + 1) / rows, width / size[0], 0.98 / rows) for row, column in places
    ]


# -- the figures -------------------------------------------------------------------------------------------------------


def samples_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, shown: int = 25, seed: int = 0
) -> Path:
    """Paths in space of a random selection of samples: a panel for each cluster, a dot at each start, the goal black.

    Spheres are not drawn, as each sample has its own.

    Args:
        path: file to write.
        samples: M solved problems.
        labels: their clusters.
        shown: number of samples drawn of each cluster, at most.
        seed: of their choice.

    Raises:
        ValueError: not one label for each sample, nothing to show, or a problem without a picture in space.
    """
    problem, generator = samples.problem, np.random.default_rng(seed)
    picture = _picture_of(problem)
    _check_labels(samples, labels)
    if shown < 1:
        raise ValueError(f"shown must be at least 1, got {shown}")
    chosen = [generator.permutation(np.flatnonzero(labels.values == i))[:shown] for i in range(labels.k)]
    size, bounds = _grid(labels.k, 5, 2.2, 2.35, right=0.1)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")  # the panels have their places
        for i, rows in enumerate(chosen):
            space = _panel(figure, bounds[i], picture, f"{_text(labels.names[i])}: {labels.sizes[i]:,}")
            for row in rows:
                _draw_path(space, picture, samples.trajectory.states[row], cluster_color(i), 0.8, 0.8)
            _draw_goal(space, picture, problem)

    return save_figure(path, size, draw)


def around_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, parameters: ArrayLike, count: int = 40
) -> Path:
    """The optimal paths of the samples nearest to one problem, coloured by cluster, round the sphere of that problem.

    Args:
        path: file to write.
        samples: M solved problems.
        labels: their clusters.
        parameters: the problem, (np,); the distance is that of :class:`~moe_policy.planners.nearest.NearestPlanner`,
            every coordinate divided by the width of its box.
        count: number of samples drawn, at most M.

    Raises:
        ValueError: not one label for each sample, not one parameter, a count that does not fit, or a problem without a
            picture in space.
    """
    problem = samples.problem
    _picture_of(problem)
    _check_labels(samples, labels)
    p = problem.check_parameters(parameters, extrapolate=True)
    if len(p) != 1:
        raise ValueError(f"expected one parameter ({len(problem.parameters)},), got {np.shape(parameters)}")
    rows = NearestPlanner(samples).neighbours(p, count)[0]
    spheres = _spheres(problem, problem.start(p)[1][0])
    picture = _closeup(problem, samples.trajectory[rows], spheres)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        space = _panel(figure, (0.0, 0.0, 0.74, 1.08), picture)  # above, there is nothing but air
        space.show(spheres)
        for row, cluster in zip(rows, labels.values[rows]):
            _draw_path(space, picture, samples.trajectory.states[row], cluster_color(cluster), 1.3, 0.9)
        _draw_goal(space, picture, problem)
        for i, number in zip(*np.unique(labels.values[rows], return_counts=True)):
            space.axes.plot([], [], [], color=cluster_color(i), label=f"{_text(labels.names[i])}: {number}")
        handles = space.axes.get_legend_handles_labels()
        figure.legend(*handles, loc="center left", bbox_to_anchor=(0.77, 0.5), title="cluster: samples")

    return save_figure(path, (6.8, 4.6), draw)


def flip_figure(
    path: str | os.PathLike[str],
    problem: OptimalControlProblem,
    parameters: ArrayLike,
    optimal: Trajectory,
    plans: Mapping[str, Trajectory],
    labels_of_lines: Sequence[str] | None = None,
) -> Path:
    """Plans along a path of parameters, in colour from first to last: a panel for the optimum and for each planner.

    The sphere is that of the first parameter. Titles tell the worst violation at the knots; in the scale of colours, a
    black line marks where the optimum jumps (:func:`~moe_policy.experiments.figures.cases.find_discontinuity`).

    Args:
        path: file to write.
        problem: one with path constraints and a picture in space.
        parameters: (K, np), with one sphere for all; :func:`~moe_policy.experiments.figures.cases.flip_parameters`
        makes them.
        optimal: K optimal trajectories.
        plans: K plans by the name of their planner.
        labels_of_lines: K texts beside the colours; by default the values of the parameter that changes most.

    Raises:
        ValueError: shapes that do not fit, optimal trajectories that are not finite, spheres that differ, or a problem
            without path constraints or without a picture in space.
    """
    p, every = problem.check_parameters(parameters, extrapolate=True), {"optimal": optimal, **plans}
    if wrong := {name: len(batch) for name, batch in every.items() if len(batch) != len(p)}:
        raise ValueError(f"expected {len(p)} trajectories, one for each parameter, got {wrong}")
    worst = {name: plan_violations(problem, p, batch).max() for name, batch in every.items()}
    flip, contexts, varied = find_discontinuity(optimal), problem.start(p)[1], int(np.ptp(p, axis=0).argmax())
    if np.ptp(contexts, axis=0).any():
        raise ValueError(f"expected one ({', '.join(problem.context.names)}) for all parameters, got different ones")
    texts = [f"{value:.3g}" for value in p[:, varied]] if labels_of_lines is None else list(labels_of_lines)
    if len(texts) != len(p):
        raise ValueError(f"expected a label for each of {len(p)} lines, got {len(texts)}")
    spheres = _spheres(problem, contexts[0])
    picture = _closeup(problem, Trajectory.concatenate(list(every.values())), spheres)
    size, bounds = _grid(len(every), 4, 3.0, 3.2, right=0.9)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        scale = figure.add_axes((1 - 0.72 / size[0], 0.2, 0.16 / size[0], 0.6))
        colors = _draw_scale(scale, texts, flip)
        if labels_of_lines is None:
            scale.set_title(f"{problem.parameters.names[varied]}, {problem.parameters.coordinates[varied].unit}")
        for place, (name, batch) in zip(bounds, every.items()):
            space = _panel(figure, place, picture, f"{name}\nworst violation {worst[name]:.3f} m")
            space.show(spheres)
            for states, color in zip(batch.states, colors):
                _draw_path(space, picture, states, color, 1.4)
            _draw_goal(space, picture, problem)

    return save_figure(path, size, draw)


def violations_figure(path: str | os.PathLike[str], violations: Mapping[str, ArrayLike], title: str) -> Path:
    """The share of cases whose violation at the knots is larger than a bound, against the bound; a line for each model.

    Args:
        path: file to write.
        violations: (B,) by model, metres, at least 0; the legend gives their means.
        title: of the figure.

    Raises:
        ValueError: no models or more than there are colours, no cases, or a violation that is negative or not finite.
    """
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
    """Mean violation at the knots against the cost, along margins: a curve for each planner, a star for the optimum.

    Args:
        path: file to write.
        rows: of the optimum, and of each planner with all margins.
    """
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
