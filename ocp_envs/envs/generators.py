"""Random generators of the rows of a vector environment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium.utils import seeding

from ocp_envs.support.arrays import Array, Ints


class Generators:
    """A random generator for each of ``rows`` rows of ``size`` numbers, seeded at random until a seed is given."""

    def __init__(self, rows: int, size: int) -> None:
        self._size = size
        self._of: list[np.random.Generator | None] = [None] * rows

    def __getitem__(self, row: int) -> np.random.Generator:
        generator = self._of[row]
        if generator is None:
            generator = self._of[row] = seeding.np_random()[0]
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

    def normal(self, rows: Ints) -> Array:
        """Standard normal numbers (len(rows), size), each row's from its own generator."""
        return np.array([self[row].standard_normal(self._size) for row in rows]).reshape(-1, self._size)
