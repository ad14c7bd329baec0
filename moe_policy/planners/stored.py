"""Stored plans as a planner: for trajectories that are known, such as solved optima that are to be tracked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory


class StoredPlans:
    """The stored plans of exactly these ``parameters`` (B, np): a ``trajectory`` of B, NaN where there is none."""

    def __init__(self, parameters: ArrayLike, trajectory: Trajectory) -> None:
        rows, flat = np.atleast_2d(np.asarray(parameters, dtype=np.float64)), trajectory.flat()
        if len(rows) != len(flat):
            raise ValueError(f"expected a plan for each of {len(rows)} parameters, got {len(flat)} plans")
        self.trajectory = trajectory
        self._row: dict[bytes, int] = {}
        for i, key in enumerate(_keys(rows)):
            first = self._row.setdefault(key, i)
            if not np.array_equal(flat[first], flat[i], equal_nan=True):
                raise ValueError(f"got two plans for the parameters {rows[i]}, rows {first} and {i}; expected one")

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), all of which must be stored."""
        rows = np.atleast_2d(np.asarray(p, dtype=np.float64))
        keys = _keys(rows)
        if unknown := [i for i, key in enumerate(keys) if key not in self._row]:
            first = rows[unknown[0]]
            raise ValueError(f"no stored plan for {len(unknown)} of {len(rows)} parameters, the first is {first}")
        return self.trajectory[np.array([self._row[key] for key in keys], dtype=np.int64)]


def _keys(rows: Array) -> list[bytes]:
    """A key for each row; +0 and −0 are equal."""
    return [row.tobytes() for row in rows + 0.0]
