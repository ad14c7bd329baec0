"""Features of the observation, as a learner sees them.

A learner gets the features φ(observation), in this order:

    sin(2π x_i / period_i), cos(2π x_i / period_i)      for a periodic state coordinate
    x_i / scale_i                                       for any other state coordinate
    2 (s_j − lower_j) / (upper_j − lower_j) − 1         for a context coordinate
    tanh((x_i ⊖ g_i) / w_ki)                            for a coordinate whose final value g_i is fixed, k = 1 … n

The last ones tell states near the goal apart, which are all alike in units of the scale: with a scale of 5 m, a goal
ball of 0.1 m is 0.02 wide. Their widths w_k are spaced geometrically, from the goal ball towards the scale.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

Float32 = NDArray[np.float32]


def widths_near_goal(problem: OptimalControlProblem, count: int) -> Array:
    """``count`` widths of features near the goal of ``problem`` for each state coordinate, (count, nx).

    The first is the goal ball, the others lie between it and the scale of the coordinate, in equal ratios.
    """
    state = problem.system.state
    ball = np.minimum(problem.goal.radius * problem.goal.tolerance_of(len(state)), state.scale)
    parts = np.arange(count)[:, None] / max(count, 1)
    return np.asarray(ball ** (1 - parts) * state.scale**parts)


class Features:
    """φ: observations of ``problem`` → features in Gymnasium's ``space`` (n,); whole turns make no difference.

    ``widths`` (n, nx) are those of the features near the goal; by default there are none.

    Raises:
        ValueError: widths of another shape, or that are not positive.
    """

    def __init__(self, problem: OptimalControlProblem, widths: Array | None = None) -> None:
        self.problem = problem
        nx = problem.system.nx
        self.widths = np.zeros((0, nx)) if widths is None else np.asarray(widths, dtype=np.float64)
        if self.widths.ndim != 2 or self.widths.shape[1] != nx or not (self.widths > 0).all():
            raise ValueError(f"{problem.id}: expected positive widths (n, {nx}), got shape {self.widths.shape}")
        self._near = np.flatnonzero(problem.terminal.fixed) if len(self.widths) else np.zeros(0, np.int64)
        state, context = problem.system.state, problem.context
        self._angles = np.flatnonzero(state.periods > 0)
        self._frequency = 2 * np.pi / state.periods[self._angles]
        self._linear = np.concatenate([np.flatnonzero(state.periods == 0), len(state) + np.arange(len(context))])
        middle = np.append(np.zeros(len(state)), context.centre)
        scale = np.append(state.scale, context.width / 2)
        self._middle, self._scale = middle[self._linear], scale[self._linear]
        self.space = self._box(np.append(state.lower, context.lower), np.append(state.upper, context.upper))

    def _box(self, lower: Array, upper: Array) -> gym.spaces.Box[np.float32]:
        """The space of the features of observations between ``lower`` and ``upper``, (nx + nc,)."""
        lower, upper = lower[self._linear], upper[self._linear]
        # Observations are float32, so features of the bounds may lie one float32 outside of theirs.
        infinity = np.float32(np.inf)
        ones, near = (np.ones(n, dtype=np.float32) for n in (2 * len(self._angles), self._near_count))
        lower = np.nextafter(((lower - self._middle) / self._scale).astype(np.float32), -infinity)
        upper = np.nextafter(((upper - self._middle) / self._scale).astype(np.float32), infinity)
        return gym.spaces.Box(
            np.concatenate([-ones, lower, -near]), np.concatenate([ones, upper, near]), dtype=np.float32
        )

    @property
    def _near_count(self) -> int:
        return len(self.widths) * len(self._near)

    @property
    def size(self) -> int:
        return 2 * len(self._angles) + len(self._linear) + self._near_count

    def __call__(self, observation: ArrayLike) -> Float32:
        """Features (..., n) of ``observation`` (..., nx + nc)."""
        values = np.asarray(observation, dtype=np.float64)
        expected = self.problem.system.nx + len(self.problem.context)
        if values.shape[-1:] != (expected,):
            raise ValueError(f"{self.problem.id}: expected observations (..., {expected}), got {values.shape}")
        angles = values[..., self._angles] * self._frequency
        linear = (values[..., self._linear] - self._middle) / self._scale
        pairs = np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(*angles.shape[:-1], 2 * angles.shape[-1])
        return np.concatenate([pairs, linear, self._closeness(values)], axis=-1).astype(np.float32)

    def _closeness(self, values: Array) -> Array:
        """The features near the goal of the observations ``values`` (..., nx + nc)."""
        if not self._near_count:
            return np.zeros((*values.shape[:-1], 0))
        states, contexts = np.split(values.reshape(-1, values.shape[-1]), [self.problem.system.nx], axis=1)
        error = self.problem.system.difference(states, self.problem.terminal.states(contexts))
        near = np.tanh(error[:, None, self._near] / self.widths[:, self._near])
        return np.asarray(near.reshape(*values.shape[:-1], self._near_count))
