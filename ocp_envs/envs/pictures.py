"""The pictures of an environment's episodes in its render mode."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ocp_envs.envs.plant import Plant
from ocp_envs.render.film import Film
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.trajectory import Trajectory


class Pictures:
    """Records the episodes of a plant if they are to be drawn, and draws them.

    Args:
        plant: whose episodes to draw.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.mode = plant.options.render_mode
        self._film = Film(plant.options.dt, plant.rows)

    def begin(self, rows: Ints) -> None:
        """Record the initial states of the episodes that begin in ``rows``."""
        if self.mode is not None:
            self._film.begin(rows, self._plant.step.state[rows])

    def record(self, rows: Ints, cost: Array) -> None:
        """Record a control step.

        Args:
            rows: indices of the episodes that moved.
            cost: cost of the step of all episodes, (rows,).
        """
        if self.mode is not None:
            self._film.record(rows, self._plant.step.state, cost)

    def announce(self, plans: Trajectory) -> None:
        """Show ``plans``, one for each row, until their episodes end.

        Raises:
            ValueError: another number of plans.
        """
        self._film.announce(np.arange(self._plant.rows), plans)

    def update(self) -> None:
        """In mode ``"human"``, show the first row in the window."""
        if self.mode == "human":
            self._film.show(self._plant.options.problem, 0, self._plant.step.context[0])

    def frames(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame (height, width, 3) for each row in mode ``"rgb_array"``; otherwise ``None``, and the window shows.

        Raises:
            ValueError: no episode has begun.
        """
        if self.mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" or "human" when the environment is made')
        self.update()
        if self.mode != "rgb_array":
            return None
        problem, contexts = self._plant.options.problem, self._plant.step.context
        return tuple(self._film.frame(problem, row, context) for row, context in enumerate(contexts))

    def close(self) -> None:
        """Close the window, if there is one."""
        self._film.close()
