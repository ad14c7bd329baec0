"""Random generators of the rows of a vector environment.

Normal numbers are drawn for many control steps at once, which takes a tenth of the time. Their order is that of single
draws: before anything else is drawn with a generator, it is set back to where single draws would have left it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding

from ocp_envs.support.arrays import Array, Ints

#: Draws of normal numbers that are made at once.
_AHEAD = 64


class Generators:
    """A random generator for each of ``rows`` rows of ``size`` numbers, seeded at random until a seed is given."""

    def __init__(self, rows: int, size: int) -> None:
        self._size = size
        self._of: list[np.random.Generator | None] = [None] * rows
        # Normal numbers that were drawn ahead, how many draws of each row are used up, and the states before them.
        self._ahead: Array = np.empty((0, _AHEAD, size))
        self._used = np.full(rows, _AHEAD)
        self._before: list[Any] = [None] * rows

    def __getitem__(self, row: int) -> np.random.Generator:
        generator = self._of[row]
        if generator is None:
            generator = self._of[row] = seeding.np_random()[0]
        if self._used[row] < _AHEAD:
            generator.bit_generator.state = self._before[row]
            generator.standard_normal(self._used[row] * self._size)
            self._used[row] = _AHEAD
        return generator

    def seed(self, seed: int | Sequence[int | None] | None, rows: Ints) -> None:
        """Restart the generators of ``rows``, and start those of rows that have none.

        An integer ``seed`` s seeds row i with s + i; a sequence holds a seed for each row, or ``None`` to leave it; one
        of another length raises a ``ValueError``.
        """
        if seed is None:
            return
        if isinstance(seed, (int, np.integer)):
            seed = [int(seed) + row for row in range(len(self._of))]
        if len(seed) != len(self._of):
            raise ValueError(f"expected an integer seed or {len(self._of)} seeds, got {len(seed)}")
        due = {*rows.tolist(), *(row for row, generator in enumerate(self._of) if generator is None)}
        for row in due:
            if seed[row] is not None:
                self._of[row] = seeding.np_random(seed[row])[0]
                self._used[row] = _AHEAD

    def normal(self, rows: Ints) -> Array:
        """Standard normal numbers (len(rows), size), each row's from its own generator."""
        if not len(self._ahead):
            self._ahead = np.empty((len(self._of), _AHEAD, self._size))
        for row in rows[self._used[rows] == _AHEAD].tolist():
            generator = self[row]
            self._before[row] = generator.bit_generator.state
            self._ahead[row] = generator.standard_normal((_AHEAD, self._size))
            self._used[row] = 0
        drawn = self._ahead[rows, self._used[rows]]
        self._used[rows] += 1
        return np.asarray(drawn)
