"""Pictures of a state with the path that led to it.

A picture is flat or in space, as the number of limits of the problem's :class:`~ocp_envs.picture.Picture` says.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from ocp_envs.picture import Picture
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.headings import heading
from ocp_envs.render.plane import Plane
from ocp_envs.render.space import Space, SpaceCurve
from ocp_envs.render.style import DASHES, GOAL, GREY, INK, PATH, PLAN, Artist, matplotlib
from ocp_envs.support.arrays import Array

_INCHES, _DPI = 5.0, 96  # 480 pixels
#: Matplotlib's backends that draw into memory or files. It chooses the first of them where there is no display.
_WITHOUT_WINDOWS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")


class Scene:
    """A figure that is drawn repeatedly; its artists are moved rather than recreated.

    It shows states of ``problem``, in an interactive ``window`` (with a warning where Matplotlib can open none) or in
    memory; ``scene.figure.savefig(...)`` writes the
    last picture to a file.

    Raises:
        ValueError: the problem has no picture.
    """

    def __init__(self, problem: OptimalControlProblem, window: bool = False) -> None:
        if problem.picture is None:
            raise ValueError(f"{problem.id} has no picture; plot_trajectory draws it against time")
        self.problem = problem
        self.picture: Picture = problem.picture
        shape = {"figsize": (_INCHES, _INCHES), "dpi": _DPI}
        self._pyplot = matplotlib("pyplot") if window else None
        if self._pyplot is not None:
            self.figure = self._pyplot.figure(problem.id, **shape)
            _warn_without_windows(problem.id, self._pyplot.get_backend())
        else:
            self.figure = matplotlib("figure").Figure(**shape)
            matplotlib("backends.backend_agg").FigureCanvasAgg(self.figure)
        self.figure.set_facecolor("white")
        self.stage: Plane | Space
        if self.picture.dimensions == 3:
            self.stage = Space(self.figure, (0.0, 0.07, 1.0, 0.88), self.picture)
            opacity, ring = 0.85, {"ms": 13, "mew": 2.2}
        else:
            self.stage = Plane(self.figure, (0.02, 0.08, 0.96, 0.84), self.picture)
            opacity, ring = 0.55, {"ms": 20, "mew": 2.5}
        self._goal = self.stage.curve("goal", ls="none", marker="o", mfc="none", mec=GOAL, **ring)
        self._shadows = _Shadows(self.stage) if isinstance(self.stage, Space) else None
        self._path = self.stage.curve("trail", color=PATH, lw=2, solid_capstyle="round", alpha=opacity)
        self._plan = self.stage.curve("plan", color=PLAN, **DASHES)
        self._legend = self._add_legend()
        self._write()

    def _write(self) -> None:
        """Title, caption, time and cost."""
        heading(self.figure, 0.965, self.problem.title, INK)
        style = {"va": "center", "size": 11, "color": INK, "family": "monospace"}
        self._clock = self.figure.text(0.06, 0.04, "", ha="left", **style)
        self._cost = self.figure.text(0.94, 0.04, "", ha="right", **style)
        if self.picture.caption:
            heading(self.figure, 0.918, self.picture.caption, "#777777", largest=8.0)

    def draw(self, states: Array, context: Array, time: float, cost: float, plan: Array | None = None) -> None:
        """Show the last of ``states`` (N, nx) and the path through all of them.

        ``context`` is (nc,); ``cost`` has accrued up to ``time`` (s), that of the last state; ``plan`` holds states
        (M, nx) at equal intervals of time, drawn dashed, of which non-finite ones are left out.
        """
        # Shapes come first: the spheres among them hide parts of a curve in space.
        self.stage.show(self.picture.shapes(states[-1], context))
        path, goals = self.picture.trace(states), self._goals(states[-1:], context[None])
        self._path.set(path)
        self._goal.set(goals)
        if self._shadows is not None:
            self._shadows.follow(path, goals)
        ahead = np.empty((0, self.picture.dimensions)) if plan is None else _smooth(self.picture.trace(plan))
        self._plan.set(ahead)
        self._legend.set_visible(plan is not None)
        self._clock.set_text(f"t = {time:5.2f} s")
        self._cost.set_text(f"cost = {cost:6.2f}")

    def _goals(self, state: Array, context: Array) -> Array:
        """Where the goals in ``context`` (1, nc) that are nearest to ``state`` (1, nx) are in the picture, (W, d)."""
        found = self.picture.trace(self.problem.terminal.nearest(state, context)[0])
        # Windings, and alternatives that look alike, are drawn once.
        return np.asarray(found[np.unique(found.round(6), axis=0, return_index=True)[1]])

    def _add_legend(self) -> Artist:
        line = matplotlib("lines").Line2D
        handles = [
            line([], [], color=PATH, lw=2, label="path" if self._shadows is None else "flown"),
            line([], [], color=PLAN, label="plan", **DASHES),
            line([], [], ls="none", marker="o", mfc="none", mec=GOAL, ms=8, mew=2, label="goal"),
        ]
        style = {"loc": "upper left", "bbox_to_anchor": (0.01, 0.94), "frameon": False, "fontsize": 9}
        return self.figure.legend(handles=handles, **style)

    def pixels(self) -> NDArray[np.uint8]:
        """The picture as (height, width, 3)."""
        self.figure.canvas.draw()
        return np.array(self.figure.canvas.buffer_rgba())[..., :3]

    def show(self) -> None:
        """Redraw the window."""
        assert self._pyplot is not None
        self.figure.canvas.draw_idle()
        self._pyplot.pause(0.001)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._pyplot is not None:
            self._pyplot.close(self.figure)


def _warn_without_windows(owner: str, backend: str) -> None:
    if backend.lower() in _WITHOUT_WINDOWS:
        warnings.warn(
            f"{owner}: no window opens, because Matplotlib's backend is {backend!r}, which has none; set DISPLAY or "
            'MPLBACKEND before Python starts, or draw into arrays with render_mode="rgb_array"',
            stacklevel=2,
        )


class _Shadows:
    """What shows depth in space: plumb lines from a goal and the system to the floor, and the path's shadow on it."""

    def __init__(self, space: Space) -> None:
        self._space = space
        self._goal = self._plumb(GOAL)
        self._under = self._plumb(INK)
        self._track = space.curve("shadow", color=GREY, lw=1.2, alpha=0.6)

    def _plumb(self, color: str) -> SpaceCurve:
        return self._space.curve("shadow", color=color, lw=0.8, ls=(0, (1, 2)))

    def _drop(self, point: Array) -> Array:
        """A line from ``point`` (1, 3) down to the floor, of points close enough together to pass behind a sphere."""
        return point + np.linspace(0, 1, 60)[:, None] * (self._space.drop(point) - point)

    def follow(self, path: Array, goals: Array) -> None:
        """Move below ``path``, (N, 3), and the first of ``goals``, (W, 3)."""
        self._goal.set(self._drop(goals[:1]))
        self._under.set(self._drop(path[-1:]))
        self._track.set(self._space.drop(path))


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
