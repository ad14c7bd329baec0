"""Standardisation: z ↦ (z − mean) / std, column by column, in float64.

A column whose standard deviation is below 1e-3 (a goal state that is the same in every sample) is only shifted: its std
is set to 1, as in Tang & Hauser's experiments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.support.doors import checked

SMALLEST_DEVIATION = 1e-3
#: Rows that are processed at once: not all need fit in memory in double precision.
BLOCK = 20_000


def blocks(count: int) -> Iterator[slice]:
    """Slices that cover ``count`` rows, :data:`BLOCK` at a time."""
    return (slice(begin, min(begin + BLOCK, count)) for begin in range(0, count, BLOCK))


@checked
@dataclass(frozen=True, eq=False)
class Standardizer:
    """The ``mean`` (n,) and the positive standard deviation ``std`` (n,) of n columns."""

    mean: Array
    std: Array

    def __post_init__(self) -> None:
        for name in ("mean", "std"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        if self.mean.ndim != 1 or self.mean.shape != self.std.shape:
            raise ValueError(f"expected mean (n,) and std (n,), got {self.mean.shape} and {self.std.shape}")
        if not (np.isfinite(self.mean).all() and np.isfinite(self.std).all() and (self.std > 0).all()):
            raise ValueError("mean and std must be finite and std positive; fit on finite data")

    def __len__(self) -> int:
        return len(self.mean)

    @classmethod
    @checked
    def fit(cls, values: ArrayLike) -> Standardizer:
        """The standardiser of finite ``values`` (M, n), M ≥ 1: those of the training split, never all data."""
        array = np.asarray(values, dtype=np.float64)
        if array.ndim != 2 or len(array) == 0:
            raise ValueError(f"expected values of shape (M, n) with at least one row, got {array.shape}")
        return cls.fit_blocks(lambda: (array[rows] for rows in blocks(len(array))))

    @classmethod
    def fit_blocks(cls, read: Callable[[], Iterable[Array]]) -> Standardizer:
        """:meth:`fit` on rows that need not be in memory together: ``read`` returns them in blocks (B, n), and is
        called twice.
        """
        count, total = 0, 0.0
        for block in read():
            if not np.isfinite(block).all():
                row = count + int(np.flatnonzero(~np.isfinite(block).all(axis=1))[0])
                raise ValueError(f"values to standardise must be finite; row {row} is not: drop unsolved samples first")
            count, total = count + len(block), total + block.sum(axis=0)
        mean = np.asarray(total / count)
        squares = sum(((block - mean) ** 2).sum(axis=0) for block in read())
        std = np.sqrt(squares / count)
        return cls(mean, np.where(std < SMALLEST_DEVIATION, 1.0, std))

    def _checked(self, values: ArrayLike) -> Array:
        array = np.asarray(values, dtype=np.float64)
        if array.shape[-1:] != self.mean.shape:
            raise ValueError(f"expected {len(self)} columns, got values of shape {array.shape}")
        return array

    @checked
    def scale(self, values: ArrayLike) -> Array:
        """Standardised ``values``, (..., n) → (..., n)."""
        return (self._checked(values) - self.mean) / self.std

    @checked
    def unscale(self, values: ArrayLike) -> Array:
        """The inverse of :meth:`scale` at ``values``, (..., n) → (..., n)."""
        return self._checked(values) * self.std + self.mean
