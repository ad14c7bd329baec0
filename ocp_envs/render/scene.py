"""Pictures of a state and of trajectories, drawn with Matplotlib from the shapes of :mod:`ocp_envs.picture`.

Matplotlib is imported when the first picture is drawn; it comes with the extra ``plots``. A picture is flat or in space
according to the number of limits of the problem's :class:`~ocp_envs.picture.Picture`.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ocp_envs.picture import Face, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.space import Space
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

_TRAIL, _GOAL, _INK, _PLAN = "#3b6ea5", "#3a8f4d", "#333333", "#d1781f"
#: zorder in the plane.
_RANKS = {"goal": 1.5, "plan": 1.7, "trail": 1.8}


def _matplotlib(module: str) -> Any:
    try:
        return importlib.import_module(f"matplotlib.{module}")
    except ImportError as error:
        raise ImportError("drawing needs Matplotlib: pip install 'ocp-moe[plots]'") from error


class Plane:
    """Axes in the plane, with the shapes of a body and curves; :class:`~ocp_envs.render.space.Space` is the same in
    space."""

    def __init__(self, figure: Any, bounds: tuple[float, float, float, float], picture: Picture) -> None:
        self.axes = figure.add_axes(bounds)
        self.axes.set(xlim=picture.limits[0], ylim=picture.limits[1])
        self.axes.set_aspect("equal")
        self.axes.set_axis_off()
        self._artists: list[tuple[type[Shape], Any]] = []

    def curve(self, rank: str, **style: Any) -> _Curve:
        """An empty curve; ``rank`` is one of :data:`_RANKS`, ``style`` as in ``Axes.plot``."""
        return _Curve(self.axes.plot([], [], zorder=_RANKS[rank], **style)[0])

    def show(self, shapes: Sequence[Shape]) -> None:
        """Show these shapes and no others."""
        if [type(shape) for shape in shapes] != [kind for kind, _ in self._artists]:
            for _, artist in self._artists:
                artist.remove()
            self._artists = [(type(shape), self._add(shape)) for shape in shapes]
        else:
            for shape, (_, artist) in zip(shapes, self._artists):
                _move(shape, artist)

    def _add(self, shape: Shape) -> Any:
        if isinstance(shape, Line):
            style = {"color": shape.color, "lw": shape.width, "solid_capstyle": "round", "zorder": 2}
            return self.axes.plot(*shape.points.T, **style)[0]
        patches = _matplotlib("patches")
        style = {"fc": shape.color, "alpha": shape.alpha, "zorder": 2.5}
        if isinstance(shape, Face):
            return self.axes.add_patch(patches.Polygon(shape.points, **style))
        return self.axes.add_patch(patches.Circle(shape.center, shape.radius, **style))


class _Curve:
    """A line in the plane."""

    def __init__(self, artist: Any) -> None:
        self._artist = artist

    def set(self, points: Array) -> None:
        """Go through ``points`` (n, 2) from now on."""
        self._artist.set_data(*points.T)


def _move(shape: Shape, artist: Any) -> None:
    if isinstance(shape, Line):
        artist.set_data(*shape.points.T)
        artist.set(color=shape.color, linewidth=shape.width)
    elif isinstance(shape, Face):
        artist.set(xy=shape.points, facecolor=shape.color, alpha=shape.alpha)
    else:
        artist.set(center=shape.center, radius=shape.radius, facecolor=shape.color, alpha=shape.alpha)


class Scene:
    """One figure that is drawn again and again; its artists are moved, not made anew.

    ``scene.figure.savefig(...)`` writes what was drawn last to a file.

    Args:
        problem: what to draw; it must have a picture.
        window: open an interactive window instead of drawing into memory.
        size: width and height in pixels; the whole picture scales with it.

    Raises:
        ImportError: Matplotlib is missing.
        ValueError: the problem has no picture.
    """

    def __init__(self, problem: OptimalControlProblem, window: bool = False, size: int = 480) -> None:
        if problem.picture is None:
            raise ValueError(f"{problem.id} has no picture; plot_trajectory draws it against time")
        self.problem = problem
        self.picture: Picture = problem.picture
        self.space = self.picture.dimensions == 3
        inches = 5.0
        if window:
            self._pyplot = _matplotlib("pyplot")
            self.figure = self._pyplot.figure(problem.id, figsize=(inches, inches), dpi=size / inches)
        else:
            self._pyplot = None
            self.figure = _matplotlib("figure").Figure(figsize=(inches, inches), dpi=size / inches)
            _matplotlib("backends.backend_agg").FigureCanvasAgg(self.figure)
        self._prepare()

    def _prepare(self) -> None:
        self.figure.set_facecolor("white")
        goal = self.picture.trace(self.problem.goal.state[None])
        trail = {"color": _TRAIL, "lw": 2, "solid_capstyle": "round"}
        plan = {"color": _PLAN, "lw": 1.6, "ls": (0, (4, 2.5))}
        if self.space:
            self._space = Space(self.figure, (0.0, 0.07, 1.0, 0.88), self.picture)
            self.stage: Plane | Space = self._space
            trail["alpha"] = 0.85
            self._ring("goal", ms=13, mew=2.2).set(goal)
            self._plumb(_GOAL).set(self._drop(goal))
            self._under = self._plumb(_INK)
            self._track = self._space.curve("shadow", color="#8a8f98", lw=1.2, alpha=0.6)
        else:
            self.stage = Plane(self.figure, (0.02, 0.08, 0.96, 0.84), self.picture)
            trail["alpha"] = 0.55
            self._ring("goal", ms=20, mew=2.5).set(goal)
        self._trail = self.stage.curve("trail", **trail)
        self._plan = self.stage.curve("plan", **plan)
        self._legend: Any = None
        self.figure.text(0.5, 0.965, self.problem.title, ha="center", va="center", size=11, color=_INK)
        style = {"va": "center", "size": 11, "color": _INK, "family": "monospace"}
        self._clock = self.figure.text(0.06, 0.04, "", ha="left", **style)
        self._cost = self.figure.text(0.94, 0.04, "", ha="right", **style)
        if self.picture.caption:
            self.figure.text(0.5, 0.925, self.picture.caption, ha="center", va="center", size=8, color="#777777")

    def _ring(self, rank: str, **style: Any) -> Any:
        return self.stage.curve(rank, ls="none", marker="o", mfc="none", mec=_GOAL, **style)

    def _plumb(self, color: str) -> Any:
        return self._space.curve("shadow", color=color, lw=0.8, ls=(0, (1, 2)))

    def _drop(self, point: Array) -> Array:
        """A line from ``point`` (1, 3) down to the floor, in pieces short enough to pass behind a sphere."""
        return point + np.linspace(0, 1, 60)[:, None] * (self._space.drop(point) - point)

    def draw(self, states: Array, context: Array, time: float, cost: float, plan: Array | None = None) -> None:
        """Show the last of ``states`` (N, nx) with the path through all of them.

        Args:
            states: flown so far.
            context: (nc,).
            time: in s.
            cost: so far.
            plan: states (M, nx) of a plan at equal intervals of time, drawn dashed; what is not finite is left out.
        """
        # The shapes first: what stands around decides what hides a path in space.
        self.stage.show(self.picture.shapes(states[-1], context))
        path = self.picture.trace(states)
        self._trail.set(path)
        if self.space:
            self._under.set(self._drop(path[-1:]))
            self._track.set(self._space.drop(path))
        ahead = np.empty((0, self.picture.dimensions)) if plan is None else _smooth(self.picture.trace(plan))
        self._plan.set(ahead)
        if plan is not None and self._legend is None:
            self._legend = self._add_legend()
        if self._legend is not None:
            self._legend.set_visible(plan is not None)
        self._clock.set_text(f"t = {time:5.2f} s")
        self._cost.set_text(f"cost = {cost:6.2f}")

    def _add_legend(self) -> Any:
        line = _matplotlib("lines").Line2D
        handles = [
            line([], [], color=_TRAIL, lw=2, label="flown" if self.space else "path"),
            line([], [], color=_PLAN, lw=1.6, ls=(0, (4, 2.5)), label="plan"),
            line([], [], ls="none", marker="o", mfc="none", mec=_GOAL, ms=8, mew=2, label="goal"),
        ]
        style = {"loc": "upper left", "bbox_to_anchor": (0.01, 0.94), "frameon": False, "fontsize": 9}
        return self.figure.legend(handles=handles, **style)

    @property
    def axes(self) -> Any:
        """Matplotlib's axes."""
        return self.stage.axes

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


def _smooth(points: Array, pieces: int = 8) -> Array:
    """A smooth curve through ``points`` (n, d) at equal intervals of time: cubics, central differences as slopes."""
    if len(points) < 3:
        return points
    slope = np.gradient(points, axis=0)
    s = np.linspace(0, 1, pieces, endpoint=False)[:, None]
    start, end = points[:-1, None], points[1:, None]
    cubic = start + (3 * s**2 - 2 * s**3) * (end - start)
    cubic = cubic + s * (1 - s) ** 2 * slope[:-1, None] - s**2 * (1 - s) * slope[1:, None]
    return np.concatenate([cubic.reshape(-1, points.shape[1]), points[-1:]])


class Film:
    """What the environments remember for their pictures: states and cost since the start of each row's episode."""

    def __init__(self, dt: float, rows: int) -> None:
        self.dt = dt
        self._states: list[list[Array]] = [[] for _ in range(rows)]
        self._cost = np.zeros(rows)
        self._plans: list[Array | None] = [None] * rows
        self._scene: Scene | None = None

    def begin(self, rows: NDArray[np.int64], states: Array) -> None:
        """New episodes in ``rows`` from ``states`` (len(rows), nx)."""
        for row, state in zip(rows, states):
            self._states[row] = [state.copy()]
            self._plans[row] = None
        self._cost[rows] = 0.0

    def record(self, rows: NDArray[np.int64], states: Array, cost: Array) -> None:
        """One more tick of ``rows``; ``states`` (n, nx) and ``cost`` (n,) are of all rows."""
        for row in rows:
            self._states[row].append(states[row].copy())
        self._cost[rows] += cost[rows]

    def announce(self, rows: NDArray[np.int64], plans: Trajectory) -> None:
        """The plans that ``rows`` follow, one each, shown until their episodes end."""
        if len(plans) != len(rows):
            raise ValueError(f"expected a plan for each of {len(rows)} rows, got {len(plans)}")
        for row, states in zip(rows, plans.states):
            self._plans[row] = states.copy()

    def _draw(self, problem: OptimalControlProblem, row: int, context: Array, window: bool) -> Scene:
        if not self._states[row]:
            raise ValueError("nothing to draw yet: call reset() before render()")
        if self._scene is None:
            self._scene = Scene(problem, window)
        time = (len(self._states[row]) - 1) * self.dt
        self._scene.draw(np.array(self._states[row]), context, time, float(self._cost[row]), self._plans[row])
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
