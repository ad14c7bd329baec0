"""The plant of an environment: control steps of its episodes with delay, disturbance and observation noise."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from ocp_envs.envs.options import Options
from ocp_envs.support.arrays import Array, Ints

#: Index of all rows: basic indexing is faster than that by an array of integers.
ALL = slice(None)
#: Standard normal numbers (len(rows), nx) for the rows given, each row's from a generator of its own.
Normal = Callable[[Ints], Array]


class Plant:
    """A number of episodes as batched arrays.

    Args:
        options: of the environment.
        rows: number of episodes.

    Attributes:
        step: the arrays of a control step; its ``state`` is the present state of each episode.
        parameters: p of each episode, (rows, np).
    """

    def __init__(self, options: Options, rows: int) -> None:
        self.options = options
        self.rows = rows
        self.step = options.simulator.control_step(rows, options.disturbed)
        self.parameters = np.zeros((rows, len(options.problem.parameters)))
        # Of shape (1, nx): with a single row nothing has to be broadcast.
        box = options.problem.system.state
        self._lower, self._upper = box.lower[None], box.upper[None]
        self._disturbance = np.asarray(options.disturbance)[None]
        self._noise = np.asarray(options.observation_noise)[None]
        self._late = deque(np.zeros((rows, options.problem.system.nu)) for _ in range(options.delay))

    def begin(self, rows: Ints, parameters: Array) -> None:
        """Begin episodes.

        Args:
            rows: indices of the episodes.
            parameters: p of each, (len(rows), np).
        """
        index = ALL if len(rows) == self.rows else rows
        self.step.state[index], self.step.context[index] = self.options.problem.start(parameters)
        self.parameters[index] = parameters
        for controls in self._late:
            controls[index] = self.options.problem.goal.control

    def advance(self, controls: Array, rows: Ints, normal: Normal) -> None:
        """Advance episodes by one control step; the results are in ``step``.

        Args:
            controls: of all episodes, (rows, nu), or (nu,) of a single one; with a delay they act later.
            rows: indices of the episodes that move; those of the others keep their state.
            normal: draws the disturbance.
        """
        step, options = self.step, self.options
        index = ALL if len(rows) == self.rows else rows
        if options.delay:
            # Rows that stand still need no exception: before such a row moves again, an episode begins in it.
            late = self._late.popleft()
            step.control[:] = late
            late[:] = controls
            self._late.append(late)
        else:
            step.control[:] = controls
        if options.disturbed:
            step.disturbance[index] = self._disturbance * normal(rows)
        step.evaluate()
        step.state[index] = step.following[index]

    def measure(self, rows: Ints, normal: Normal) -> Array:
        """The states (len(rows), nx) of episodes with observation noise, clipped to the operating box.

        Args:
            rows: indices of the episodes.
            normal: draws the noise.
        """
        state = self.step.state if len(rows) == self.rows else self.step.state[rows]
        measured: Array = state + self._noise * normal(rows)
        np.maximum(measured, self._lower, out=measured)
        return np.minimum(measured, self._upper, out=measured)
