"""What the environments record of their episodes so that these can be drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.scene import Scene
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.trajectory import Trajectory


class Film:
    """What an environment records for its pictures: states, cost and plan of the current episode of each row.

    Args:
        dt: length of a control step, s.
        rows: number of episodes.
    """

    def __init__(self, dt: float, rows: int) -> None:
        self.dt = dt
        self._states: list[list[Array]] = [[] for _ in range(rows)]
        self._cost = np.zeros(rows)
        self._plans: list[Array | None] = [None] * rows
        self._scene: Scene | None = None

    def begin(self, rows: Ints, states: Array) -> None:
        """Begin episodes.

        Args:
            rows: indices of the episodes that begin.
            states: their initial states, (len(rows), nx).
        """
        for row, state in zip(rows, states):
            self._states[row] = [state.copy()]
            self._plans[row] = None
        self._cost[rows] = 0.0

    def record(self, rows: Ints, states: Array, cost: Array) -> None:
        """Record one control step.

        Args:
            rows: indices of the episodes that moved.
            states: states of all rows, (n, nx).
            cost: cost of the control step of all rows, (n,).
        """
        for row in rows:
            self._states[row].append(states[row].copy())
        self._cost[rows] += cost[rows]

    def announce(self, rows: Ints, plans: Trajectory) -> None:
        """Show plans until the episodes that follow them end.

        Args:
            rows: indices of the episodes.
            plans: one for each of them.

        Raises:
            ValueError: another number of plans.
        """
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
        """The picture of an episode.

        Args:
            problem: the problem to draw.
            row: index of the episode.
            context: its context, (nc,).

        Returns:
            (height, width, 3).

        Raises:
            ValueError: the episode has not begun, or the problem has no picture.
            ImportError: Matplotlib is not installed.
        """
        return self._draw(problem, row, context, window=False).pixels()

    def show(self, problem: OptimalControlProblem, row: int, context: Array) -> None:
        """Show the picture of an episode in a window.

        Args:
            problem, row, context: as in :meth:`frame`, with the same errors.
        """
        self._draw(problem, row, context, window=True).show()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_scene": None}  # figures neither copy nor pickle; a new one is made when needed
