"""Pictures of a state and of trajectories, drawn with Matplotlib from the shapes of :mod:`ocp_envs.picture`.

Matplotlib is imported when the first picture is drawn; it comes with the extra ``plots``. A picture is flat or in space
according to the number of limits of the problem's :class:`~ocp_envs.picture.Picture`.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ocp_envs.picture import Ball, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory

_TRAIL, _GOAL, _INK = "#3b6ea5", "#3a8f4d", "#333333"


def _matplotlib(module: str) -> Any:
    try:
        return importlib.import_module(f"matplotlib.{module}")
    except ImportError as error:
        raise ImportError("drawing needs Matplotlib: pip install 'ocp-moe[plots]'") from error


class Scene:
    """One figure that is drawn again and again; its artists are moved, not made anew.

    Args:
        problem: what to draw; it must have a picture.
        window: open an interactive window instead of drawing into memory.
        size: width and height in pixels.

    Raises:
        ImportError: Matplotlib is missing.
        ValueError: the problem has no picture.
    """

    def __init__(self, problem: OptimalControlProblem, window: bool = False, size: int = 480) -> None:
        if problem.picture is None:
            raise ValueError(f"{problem.id} has no picture; plot_trajectory draws it against time")
        self.problem = problem
        self.picture: Picture = problem.picture
        self.space = len(self.picture.limits) == 3
        dpi = 96
        if window:
            self._pyplot = _matplotlib("pyplot")
            self.figure = self._pyplot.figure(problem.id, figsize=(size / dpi, size / dpi), dpi=dpi)
        else:
            self._pyplot = None
            self.figure = _matplotlib("figure").Figure(figsize=(size / dpi, size / dpi), dpi=dpi)
            _matplotlib("backends.backend_agg").FigureCanvasAgg(self.figure)
        self._artists: list[tuple[Shape, Any]] = []
        self._prepare()

    def _prepare(self) -> None:
        self.figure.set_facecolor("white")
        projection = {"projection": "3d"} if self.space else {}
        self.axes = self.figure.add_axes((0.02, 0.08, 0.96, 0.84), **projection)
        limits = self.picture.limits
        self.axes.set(xlim=limits[0], ylim=limits[1])
        if self.space:
            self.axes.set(zlim=limits[2], xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
            self.axes.set_box_aspect([high - low for low, high in limits])
        else:
            self.axes.set_aspect("equal")
            self.axes.set_axis_off()
        goal = self.picture.path(self.problem.goal.state[None])[0]
        self.axes.plot(*goal[:, None], "o", ms=20, mfc="none", mec=_GOAL, mew=2.5, zorder=1.5)
        empty = [np.empty(0)] * len(limits)
        (self._trail,) = self.axes.plot(*empty, color=_TRAIL, lw=2, alpha=0.55, zorder=1.8, solid_capstyle="round")
        self.figure.text(0.5, 0.965, self.problem.title, ha="center", va="center", size=11, color=_INK)
        style = {"va": "center", "size": 11, "color": _INK, "family": "monospace"}
        self._clock = self.figure.text(0.06, 0.04, "", ha="left", **style)
        self._cost = self.figure.text(0.94, 0.04, "", ha="right", **style)

    def draw(self, states: Array, context: Array, time: float, cost: float) -> None:
        """Show the last of ``states`` (N, nx) with the path through all of them, ``time`` in s and the cost so far."""
        shapes = list(self.picture.body(states[-1], context))
        fits = len(shapes) == len(self._artists) and all(
            type(new) is type(old) for new, (old, _) in zip(shapes, self._artists)
        )
        if not fits:
            for _, artist in self._artists:
                artist.remove()
            self._artists = [(shape, self._add(shape)) for shape in shapes]
        else:
            self._artists = [(shape, self._move(shape, *old)) for shape, old in zip(shapes, self._artists)]
        path = self.picture.path(states)
        if self.space:
            self._trail.set_data_3d(*path.T)
        else:
            self._trail.set_data(*path.T)
        self._clock.set_text(f"t = {time:5.2f} s")
        self._cost.set_text(f"cost = {cost:6.2f}")

    def _add(self, shape: Shape) -> Any:
        if isinstance(shape, Line):
            return self.axes.plot(*shape.points.T, color=shape.color, lw=shape.width, solid_capstyle="round", zorder=2)[
                0
            ]
        if self.space:
            x, y, z = _sphere(shape)
            return self.axes.plot_surface(x, y, z, color=shape.color, alpha=shape.alpha, linewidth=0)
        circle = _matplotlib("patches").Circle(
            shape.center, shape.radius, fc=shape.color, alpha=shape.alpha, zorder=2.5
        )
        return self.axes.add_patch(circle)

    def _move(self, shape: Shape, old: Shape, artist: Any) -> Any:
        """``artist`` of the ``old`` shape, of the same type, after it has become ``shape``."""
        if isinstance(shape, Line):
            if self.space:
                artist.set_data_3d(*shape.points.T)
            else:
                artist.set_data(*shape.points.T)
            artist.set(color=shape.color, linewidth=shape.width)
        elif not self.space:
            artist.set(center=shape.center, radius=shape.radius, facecolor=shape.color, alpha=shape.alpha)
        elif not _same_ball(shape, old):
            artist.remove()
            return self._add(shape)
        return artist

    def pixels(self) -> NDArray[np.uint8]:
        """The picture as (height, width, 3)."""
        self.figure.canvas.draw()
        return np.array(self.figure.canvas.buffer_rgba())[..., :3]

    def show(self) -> None:
        """Bring the window up to date."""
        assert self._pyplot is not None
        self.figure.canvas.draw_idle()
        self._pyplot.pause(0.001)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._pyplot is not None:
            self._pyplot.close(self.figure)


def _same_ball(a: Ball, b: Any) -> bool:
    same_look = (a.radius, a.color, a.alpha) == (b.radius, b.color, b.alpha)
    return same_look and np.array_equal(a.center, b.center)


def _sphere(ball: Ball) -> tuple[Array, Array, Array]:
    longitude, latitude = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    x = ball.center[0] + ball.radius * np.cos(longitude) * np.sin(latitude)
    y = ball.center[1] + ball.radius * np.sin(longitude) * np.sin(latitude)
    z = ball.center[2] + ball.radius * np.cos(latitude)
    return x, y, z


class Film:
    """What the environments remember for their pictures: states and cost since the start of each row's episode."""

    def __init__(self, dt: float, rows: int) -> None:
        self.dt = dt
        self._states: list[list[Array]] = [[] for _ in range(rows)]
        self._cost = np.zeros(rows)
        self._scene: Scene | None = None

    def begin(self, rows: NDArray[np.int64], states: Array) -> None:
        """New episodes in ``rows`` from ``states`` (len(rows), nx)."""
        for row, state in zip(rows, states):
            self._states[row] = [state.copy()]
        self._cost[rows] = 0.0

    def record(self, rows: NDArray[np.int64], states: Array, cost: Array) -> None:
        """One more tick of ``rows``; ``states`` (n, nx) and ``cost`` (n,) are of all rows."""
        for row in rows:
            self._states[row].append(states[row].copy())
        self._cost[rows] += cost[rows]

    def _draw(self, problem: OptimalControlProblem, row: int, context: Array, window: bool) -> Scene:
        if not self._states[row]:
            raise ValueError("nothing to draw yet: call reset() before render()")
        if self._scene is None:
            self._scene = Scene(problem, window)
        time = (len(self._states[row]) - 1) * self.dt
        self._scene.draw(np.array(self._states[row]), context, time, float(self._cost[row]))
        return self._scene

    def frame(self, problem: OptimalControlProblem, row: int, context: Array) -> NDArray[np.uint8]:
        """The picture of ``row`` as (height, width, 3)."""
        return self._draw(problem, row, context, window=False).pixels()

    def show(self, problem: OptimalControlProblem, row: int, context: Array) -> None:
        """The picture of ``row`` in a window."""
        self._draw(problem, row, context, window=True).show()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_scene": None}  # figures neither copy nor pickle; a new one is made when needed


def plot_trajectory(problem: OptimalControlProblem, trajectory: Trajectory, axes: Any = None) -> NDArray[Any]:
    """States and controls of a batch of trajectories against time, one panel per coordinate.

    Args:
        problem: whose trajectories they are.
        trajectory: a batch; each member is a line.
        axes: nx + nu Matplotlib axes to draw into; a new figure by default.

    Returns:
        The axes, (nx + nu,), states first; ``axes[0].figure`` is the figure.

    Raises:
        ValueError: another number of axes.
        ImportError: Matplotlib is missing.
    """
    system = problem.system
    coordinates = (*system.state.coordinates, *system.control.coordinates)
    if axes is None:
        columns = 1 if len(coordinates) <= 4 else 4
        rows = math.ceil(len(coordinates) / columns)
        size = (3.2 * columns + 2.4 * (columns == 1), 1.8 * rows)
        figure = _matplotlib("pyplot").figure(figsize=size, layout="constrained")
        axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for unused in axes.ravel()[len(coordinates) :]:
            unused.set_visible(False)
        axes = axes.ravel()[: len(coordinates)]
    axes = np.asarray(axes).ravel()
    if len(axes) != len(coordinates):
        raise ValueError(f"{problem.id}: expected {len(coordinates)} axes (states, controls), got {len(axes)}")
    times = trajectory.times
    for i, (coordinate, panel) in enumerate(zip(coordinates, axes)):
        unit = "" if coordinate.unit == "1" else f" ({coordinate.unit})"
        panel.set_ylabel(f"{coordinate.name}{unit}")
        if i < system.nx:
            panel.plot(times.T, trajectory.states[:, :, i].T, lw=1.5)
            for target in np.unique(problem.targets[:, i]):
                panel.axhline(target, color=_GOAL, lw=1, ls=":")
        else:
            held = np.concatenate([trajectory.controls, trajectory.controls[:, -1:]], axis=1)[:, :, i - system.nx]
            panel.plot(times.T, held.T, lw=1.5, drawstyle="steps-post")
            for bound in (coordinate.lower, coordinate.upper):
                panel.axhline(bound, color=_INK, lw=1, ls="--")
        panel.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time (s)")
    return np.asarray(axes)
