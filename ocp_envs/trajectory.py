"""Batches of trajectories on a uniform time grid, and their flat layout.

A trajectory has N knots t_i = i·t_f/(N-1), states x_i at the knots and controls u_i held over [t_i, t_{i+1}):

    z = [x_0 … x_{N-1} | u_0 … u_{N-2} | t_f],   length N·nx + (N-1)·nu + 1
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.support.arrays import Array, read_only
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch


def flat_size(knots: int, nx: int, nu: int) -> int:
    """Length of the flat layout of ``knots`` knots with ``nx`` states and ``nu`` controls."""
    return knots * nx + (knots - 1) * nu + 1


@checked
@dataclass(frozen=True, eq=False)
class Trajectory(Batch):
    """A batch of B trajectories.

    Args:
        states: (B, N, nx), angles unwrapped.
        controls: (B, N-1, nu).
        duration: t_f in seconds, (B,).

    The arrays are read-only views of those given. Values may be non-finite (a failed solve is a value); shapes must
    agree, else ``ValueError``.
    """

    states: Array
    controls: Array
    duration: Array

    def __post_init__(self) -> None:
        for name in ("states", "controls", "duration"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name), dtype=np.float64)))
        x, u, t = self.states, self.controls, self.duration
        if x.ndim != 3 or u.ndim != 3 or t.ndim != 1 or not len(x) == len(u) == len(t) or u.shape[1] != x.shape[1] - 1:
            raise ValueError(
                f"expected states (B, N, nx), controls (B, N-1, nu), duration (B,); got {x.shape}, {u.shape}, {t.shape}"
            )

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[i] for i in range(len(self)))

    @property
    def knots(self) -> int:
        return int(self.states.shape[1])

    @property
    def step(self) -> Array:
        """Length of an interval in seconds, (B,)."""
        return self.duration / (self.knots - 1)

    @property
    def times(self) -> Array:
        """Times of the knots in seconds, (B, N)."""
        return self.step[:, None] * np.arange(self.knots)

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Whether all values of a trajectory are finite, (B,)."""
        inside = [np.isfinite(part).all(axis=(1, 2)) for part in (self.states, self.controls)]
        return np.asarray(inside[0] & inside[1] & np.isfinite(self.duration))

    def flat(self) -> Array:
        """The flat layout z, (B, N·nx + (N-1)·nu + 1)."""
        size = len(self)
        return np.concatenate(
            [
                self.states.reshape(size, self.states.shape[1] * self.states.shape[2]),
                self.controls.reshape(size, self.controls.shape[1] * self.controls.shape[2]),
                self.duration[:, None],
            ],
            axis=1,
        )

    def shifted(self, offset: Array) -> Trajectory:
        """These trajectories with ``offset`` (B, nx) added to all states of each."""
        return replace(self, states=self.states + offset[:, None]) if offset.any() else self

    @classmethod
    @checked
    def from_flat(cls, z: ArrayLike, knots: int, nx: int, nu: int) -> Trajectory:
        """The inverse of :meth:`flat`.

        Args:
            z: (B, flat_size) or (flat_size,).
            knots, nx, nu: number of knots, states and controls.

        Raises:
            ValueError: another length.
        """
        z = np.atleast_2d(np.asarray(z, dtype=np.float64))
        if z.ndim != 2 or z.shape[1] != flat_size(knots, nx, nu):
            raise ValueError(f"expected (B, {flat_size(knots, nx, nu)}) flat trajectories, got {z.shape}")
        split = knots * nx
        return cls(z[:, :split].reshape(-1, knots, nx), z[:, split:-1].reshape(-1, knots - 1, nu), z[:, -1].copy())
