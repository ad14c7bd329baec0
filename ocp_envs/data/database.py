"""Databases of optimal trajectories, with one slot for each solution family of each instance."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.data.layout import COUNTS, CURE, MISSING, DatabaseError, StoredRows
from ocp_envs.data.samples import Samples
from ocp_envs.data.stored_database import StoredDatabase
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Ints, scratch
from ocp_envs.support.doors import checked

#: Rows of all families read into memory at a time.
_BLOCK = 5_000


class Database(StoredDatabase):
    """A database; :meth:`create` makes a new one, :meth:`open` opens an existing one."""

    @property
    def key(self) -> str:
        """A hash of problem, settings, parameters and growth: of everything that determines a complete database."""
        grown = [self._description.sizes] if len(self._description.sizes) > 1 else []
        record = json.dumps([self.problem.fingerprint, self._description.settings, *grown], sort_keys=True)
        return _hash([np.frombuffer(record.encode(), np.uint8), self.parameters])

    def _status(self, rows: slice | None = None) -> NDArray[np.int8]:
        """How ``rows`` ended, all by default; ``MISSING`` where they do not exist."""
        return np.where(self._exist[rows or slice(None)], self._read("status", rows), np.int8(MISSING))

    @property
    def status(self) -> NDArray[np.int8]:
        """How each instance ended, (M,), a :class:`~ocp_envs.solvers.nlp.Status`; −1 where it is not solved yet."""
        return self._status()[self._row_of_index]

    def stored(self, rows: slice) -> StoredRows:
        """What is stored of ``rows``.

        Raises:
            DatabaseError: damaged files, or pieces of written chunks that are missing.
        """
        arrays = {name: self._read(name, rows) for name in self._columns}
        read = StoredRows(**arrays | {"status": self._status(rows)})
        found, solved = read.found, read.status == Status.SOLVED
        whole = np.isfinite(read.cost[found]).all() and np.isfinite(read.z[found]).all()
        if not (whole and found[solved].any(axis=1).all()):
            raise DatabaseError(f"{self.path} is damaged: stored trajectories are missing; {CURE}")
        return read

    def blocks(self, stop: int | None = None) -> Iterator[tuple[slice, StoredRows]]:
        """Rows 0 … ``stop`` (all by default), a few thousand at a time, so that memory is bounded."""
        for rows in self._spans(len(self) if stop is None else stop):
            yield rows, self.stored(rows)

    def _spans(self, stop: int) -> list[slice]:
        """Rows 0 … ``stop`` in whole chunks, a few thousand rows at a time."""
        step = self.chunk * max(1, _BLOCK // self.chunk)
        return [slice(begin, min(begin + step, stop)) for begin in range(0, stop, step)]

    def costs(self) -> Array:
        """The best cost of every family of every instance, (M, modes); +inf where none was found."""
        return self._read("cost")[self._row_of_index]

    def first(self, count: int | None) -> Ints:
        """Indices of the ``count`` instances that are solved first, chosen at random, ascending; all where ``None``.

        Raises:
            DatabaseError: they are not solved yet.
        """
        rows = len(self) if count is None else min(count, len(self))
        solved = int(self._exist[:rows].sum())
        if solved < rows:
            raise DatabaseError(f"{self.path}: {solved} of the first {rows} instances are solved; generate the others")
        return np.sort(self._index_of_row[:rows])

    def solved(self, indices: Ints) -> Ints:
        """Those of ``indices`` whose instance has a solution."""
        return indices[(self._status() == Status.SOLVED)[self._row_of_index[indices]]]

    @checked
    def samples(self, indices: ArrayLike | None = None) -> Samples:
        """The best solution of every instance that has one.

        Memory: the best solutions alone, in a file where they are many (:func:`~ocp_envs.support.arrays.scratch`), and
        a few thousand rows of all families while they are read.

        Args:
            indices: which instances, (K,), all by default; the samples are in this order.

        Raises:
            DatabaseError: damaged files.
            ValueError: indices that the database does not have.
        """
        wanted = np.arange(len(self)) if indices is None else np.asarray(indices)
        known = (wanted >= 0) & (wanted < len(self)) & (wanted == np.floor(wanted))
        if wanted.ndim != 1 or wanted.dtype == bool or not known.all():
            raise ValueError(f"{self.path}: expected indices (K,) in 0 … {len(self) - 1}, got {wanted!r:.99}")
        wanted = wanted.astype(np.int64)
        index, problem = self.solved(wanted), self.problem
        mode_costs, rows = self.costs()[index], self._row_of_index[index]
        mode = np.asarray(mode_costs.argmin(axis=1), dtype=np.int64)
        z = scratch((len(index), problem.flat_size), np.float64)
        multipliers = np.empty((len(index), problem.knots, problem.n_clearances))
        for span in self._spans(len(self)):
            here = np.flatnonzero((rows >= span.start) & (rows < span.stop))
            if len(here):  # only the blocks that are needed are read
                block, slot = self.stored(span), (rows[here] - span.start, mode[here])
                z[here], multipliers[here] = block.z[slot], block.multipliers[slot]
        return Samples(
            problem=problem,
            parameters=self.parameters[index],
            trajectory=problem.unflatten(z),
            cost=mode_costs[np.arange(len(index)), mode],
            mode=mode,
            multipliers=multipliers,
            mode_costs=mode_costs,
            index=index,
        )

    def totals(self) -> dict[str, int]:
        """Sums over all rows that were written: instances, solved ones, and the solver statistics."""
        status, present = self._status(), self._exist
        record = {"problems": int(present.sum()), "solved": int((status == Status.SOLVED).sum())}
        return record | {name: int(self._read(name)[present].sum()) for name in COUNTS}

    def digest(self) -> str:
        """A hash of all arrays: equal for equal databases."""
        stored = (self._read(name, rows) for name in sorted(self._columns) for rows in self._spans(len(self)))
        return _hash(chain([self.parameters, self._index_of_row], stored))


def _hash(parts: Iterable[NDArray[Any]]) -> str:
    sha = hashlib.sha256()
    for part in parts:
        sha.update(np.ascontiguousarray(part).tobytes())
    return sha.hexdigest()
