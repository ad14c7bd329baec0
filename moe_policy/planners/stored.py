"""Stored plans as a planner: for trajectories that are known, such as solved optima that are to be tracked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.data.neighbours import Neighbours
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: How far parameters may be from stored ones after whole turns, in box widths: rounding errors.
_ROUNDING = 1e-12


class StoredPlans:
    """The stored plans of exactly these parameters.

    Args:
        parameters: (B, np).
        trajectory: B plans, NaN where there is none.
        problem: what is planned for. If it is given, the plans are also found for parameters whose angles are written
            in another turn, and begin in that turn.

    Raises:
        ValueError: another number of plans than of parameters, or two plans for the same parameters.
    """

    @checked
    def __init__(self, parameters: ArrayLike, trajectory: Trajectory, problem: ProblemOrId | None = None) -> None:
        problem = None if problem is None else problem_of(problem)
        self.problem = problem
        rows, turns = self._in_one_turn(parameters)
        if len(rows) != len(trajectory):
            raise ValueError(f"expected a plan for each of {len(rows)} parameters, got {len(trajectory)} plans")
        self._turned = trajectory.shifted(-turns)
        self.trajectory, flat = trajectory, self._turned.flat()
        self._stored = None if problem is None or not len(rows) else Neighbours(problem.parameters, rows)
        self._row: dict[bytes, int] = {}
        for i, key in enumerate(_keys(rows)):
            first = self._row.setdefault(key, i)
            if not np.array_equal(flat[first], flat[i], equal_nan=True):
                raise ValueError(f"got two plans for the parameters {rows[i]}, rows {first} and {i}; expected one")

    def _in_one_turn(self, p: ArrayLike) -> tuple[Array, Array]:
        if self.problem is not None:
            return self.problem.in_one_turn(p)
        return np.atleast_2d(np.asarray(p, dtype=np.float64)), np.zeros((1, 1))

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), all of which must be stored."""
        rows, turns = self._in_one_turn(p)
        found = np.array([self._row.get(key, -1) for key in _keys(rows)], dtype=np.int64)
        missing = np.flatnonzero(found < 0)
        found[missing] = self._after_turns(rows[missing])
        if unknown := np.flatnonzero(found < 0).tolist():
            first = rows[unknown[0]]
            raise ValueError(f"no stored plan for {len(unknown)} of {len(rows)} parameters, the first is {first}")
        return self._turned[found].shifted(turns)

    def _after_turns(self, rows: Array) -> Ints:
        """Which stored parameters equal ``rows`` (M, np) apart from rounding, (M,); −1 for none."""
        if self._stored is None or not len(rows):
            return np.full(len(rows), -1)
        distance, nearest = self._stored.nearest(rows, 1)
        return np.where(distance[:, 0] < _ROUNDING, nearest[:, 0], -1)


def _keys(rows: Array) -> list[bytes]:
    """A key for each row; +0 and −0 are equal."""
    return [row.tobytes() for row in rows + 0.0]
