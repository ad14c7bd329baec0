"""The interface of a reinforcement learner: features of the observation, and actions in [-1, 1].

A learner gets the features φ(observation), in this order:

    sin(2π x_i / period_i), cos(2π x_i / period_i)      for a periodic state coordinate
    x_i / scale_i                                       for any other state coordinate
    2 (s_j − lower_j) / (upper_j − lower_j) − 1         for a context coordinate

and its action a ∈ [-1, 1]^nu represents the control u = lower + (a + 1) (upper − lower) / 2.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

Float32 = NDArray[np.float32]


class Features:
    """φ: observations of ``problem`` → features in Gymnasium's ``space`` (n,); whole turns make no difference."""

    def __init__(self, problem: OptimalControlProblem) -> None:
        self.problem = problem
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
        infinity, ones = np.float32(np.inf), np.ones(2 * len(self._angles), dtype=np.float32)
        lower = np.nextafter(((lower - self._middle) / self._scale).astype(np.float32), -infinity)
        upper = np.nextafter(((upper - self._middle) / self._scale).astype(np.float32), infinity)
        return gym.spaces.Box(np.append(-ones, lower), np.append(ones, upper), dtype=np.float32)

    @property
    def size(self) -> int:
        return 2 * len(self._angles) + len(self._linear)

    def __call__(self, observation: ArrayLike) -> Float32:
        """Features (..., n) of ``observation`` (..., nx + nc)."""
        values = np.asarray(observation, dtype=np.float64)
        expected = self.problem.system.nx + len(self.problem.context)
        if values.shape[-1:] != (expected,):
            raise ValueError(f"{self.problem.id}: expected observations (..., {expected}), got {values.shape}")
        angles = values[..., self._angles] * self._frequency
        linear = (values[..., self._linear] - self._middle) / self._scale
        pairs = np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(*angles.shape[:-1], 2 * angles.shape[-1])
        return np.concatenate([pairs, linear], axis=-1).astype(np.float32)


class Actions:
    """Actions in Gymnasium's ``space`` [-1, 1] ↔ controls of ``problem`` in their box; actions outside are clipped."""

    def __init__(self, problem: OptimalControlProblem) -> None:
        box = problem.system.control
        self._lower, self._half = box.lower, box.width / 2
        self.space = gym.spaces.Box(-1.0, 1.0, (len(box),), dtype=np.float32)

    def controls(self, actions: ArrayLike) -> Array:
        """Controls (..., nu) in physical units, for ``actions`` (..., nu)."""
        return self._lower + (np.clip(np.asarray(actions, dtype=np.float64), -1, 1) + 1) * self._half

    def actions(self, controls: ArrayLike) -> Array:
        """The inverse of :meth:`controls` inside the box, for ``controls`` (..., nu)."""
        return (np.asarray(controls, dtype=np.float64) - self._lower) / self._half - 1
