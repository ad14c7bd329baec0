"""The pictures of an environment's episodes in its render mode."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ocp_envs.envs.plant import Plant
from ocp_envs.render.scene import Scene
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.trajectory import Trajectory


class Pictures:
    """Records states, cost and plan of the current episodes of a ``plant`` if they are to be drawn, and draws them."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.mode = plant.options.render_mode
        self._states: list[list[Array]] = [[] for _ in range(plant.rows)]
        self._cost = np.zeros(plant.rows)
        self._plans: list[Array | None] = [None] * plant.rows
        self._scene: Scene | None = None

    def begin(self, rows: Ints) -> None:
        """Record the initial states of the episodes that begin in ``rows``."""
        if self.mode is not None:
            for row in rows:
                self._states[row] = [self._plant.step.state[row].copy()]
                self._plans[row] = None
            self._cost[rows] = 0.0

    def record(self, rows: Ints, cost: Array) -> None:
        """Record a control step of the episodes in ``rows``; ``cost`` is that of the step for all episodes."""
        if self.mode is not None:
            for row in rows:
                self._states[row].append(self._plant.step.state[row].copy())
            self._cost[rows] += cost[rows]

    def announce(self, plans: Trajectory) -> None:
        """Show ``plans``, one for each row (else a ``ValueError``), until their episodes end."""
        if len(plans) != self._plant.rows:
            raise ValueError(f"expected a plan for each of {self._plant.rows} rows, got {len(plans)}")
        self._plans = [states.copy() for states in plans.states]

    def _draw(self, row: int) -> Scene:
        options, states = self._plant.options, self._states[row]
        if not states:
            raise ValueError("nothing to draw yet: call reset() before render()")
        if self._scene is None:
            self._scene = Scene(options.problem, window=self.mode == "human")
        time, context = (len(states) - 1) * options.dt, self._plant.context[row]
        self._scene.draw(np.array(states), context, time, float(self._cost[row]), self._plans[row])
        return self._scene

    def update(self) -> None:
        """In mode ``"human"``, show the first row in the window."""
        if self.mode == "human":
            self._draw(0).show()

    def frames(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame (height, width, 3) for each row in mode ``"rgb_array"``; otherwise ``None``, and the window shows."""
        if self.mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" or "human" when the environment is made')
        self.update()
        if self.mode != "rgb_array":
            return None
        return tuple(self._draw(row).pixels() for row in range(self._plant.rows))

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_scene": None}  # figures neither copy nor pickle; a new one is made when needed
