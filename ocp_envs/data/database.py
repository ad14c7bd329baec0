"""Databases of optimal trajectories on disk, with one slot for each solution family of each instance.

Three numbers belong to an instance:

    index i   its position in the parameters as they were given (arguments named ``indices``).
    row r     its position on disk, in the order in which the instances are solved (arguments named ``rows``).
              The array ``order`` holds the index of each row, i = order[r]; its inverse holds the row of each index.
    chunk     ⌊r / rows per chunk⌋: the rows of a chunk are solved in one task and written in one step.

The files are described in :mod:`ocp_envs.data.layout`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

from ocp_envs.data.layout import COUNTS, MISSING, DatabaseError, StoredRows, create_group, layout, open_group
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Bools, Ints, scratch

#: Rows of all families read into memory at a time.
_BLOCK = 5_000


class Database:
    """A database; :meth:`create` makes a new one, :meth:`open` opens an existing one.

    It lies in the folder ``path`` with the files ``group`` and was made for ``problem``.
    """

    def __init__(self, path: Path, group: zarr.Group, problem: OptimalControlProblem) -> None:
        self.path, self.problem, self._group = path, problem, group
        self._arrays = dict(group.arrays())
        self._index_of_row: Ints = self._read("order")
        self._row_of_index: Ints = np.argsort(self._index_of_row)

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        problem: OptimalControlProblem,
        parameters: ArrayLike,
        *,
        order: ArrayLike | None = None,
        settings: Mapping[str, object] | None = None,
        chunk: int = 100,
    ) -> Database:
        """A new database without any solved row.

        Args:
            path: folder, must not exist.
            problem: what it is for.
            parameters: (M, np).
            order: index of each row, a permutation of 0 … M − 1; by default rows are in the order of the parameters.
            settings: how it is made, as JSON.
            chunk: rows that are written at a time.

        Raises:
            DatabaseError: the path exists.
            ValueError: parameters of the wrong shape or not finite, or an order that is no permutation.
        """
        p = problem.check_parameters(parameters, extrapolate=True)
        rows = np.arange(len(p)) if order is None else np.asarray(order, dtype=np.int64)
        if not np.array_equal(np.sort(rows), np.arange(len(p))):
            raise ValueError(f"order must be a permutation of 0 … {len(p) - 1}")
        create_group(Path(path), problem, p, rows, settings or {}, chunk)
        return cls.open(path, problem)

    @classmethod
    def open(cls, path: str | os.PathLike[str], problem: OptimalControlProblem | None = None) -> Database:
        """The database in the folder ``path``, made for ``problem``; by default for the registered one of its id.

        Raises:
            DatabaseError: not a database, damaged, or made for another problem.
        """
        return cls(Path(path), *open_group(Path(path), problem))

    def _read(self, name: str, rows: slice | None = None) -> NDArray[Any]:
        try:
            return np.asarray(self._arrays[name][rows or slice(None)])
        except (OSError, ValueError, RuntimeError, KeyError) as error:
            message = f"{self.path} is damaged: {name} cannot be read ({error}); generate it again"
            raise DatabaseError(message) from error

    def __len__(self) -> int:
        return len(self._index_of_row)

    @cached_property
    def parameters(self) -> Array:
        """Parameters of all instances by index, (M, np)."""
        return self._read("parameters")

    @property
    def settings(self) -> dict[str, object]:
        """The settings it was made with, as JSON."""
        return json.loads(json.dumps(self._group.attrs["settings"]))

    @property
    def key(self) -> str:
        """A hash of problem, settings and parameters: of everything that determines a complete database."""
        record = [self.problem.fingerprint, self._group.attrs["settings"]]
        return _hash([np.frombuffer(json.dumps(record, sort_keys=True).encode(), np.uint8), self.parameters])

    @property
    def chunk(self) -> int:
        """Number of rows in a chunk; the last chunk may have fewer."""
        return int(self._group.attrs["chunk"])

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-len(self) // self.chunk)

    def stored_rows(self, chunk: int) -> slice:
        """The rows of the chunk with number ``chunk``."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, len(self)))

    def stored_parameters(self, rows: slice) -> Array:
        """Parameters of ``rows``, (B, np)."""
        return self.parameters[self._index_of_row[rows]]

    def present(self) -> Bools:
        """Which chunks were written, (chunks,)."""
        return self._read("status")[:: self.chunk] != MISSING

    @property
    def complete(self) -> bool:
        """Whether all chunks were written."""
        return bool(self.present().all())

    def write(self, chunk: int, rows: StoredRows) -> None:
        """Write ``rows`` as the chunk with number ``chunk``; ``status`` goes last."""
        where = self.stored_rows(chunk)
        for name in layout(self.problem):
            if name != "status":
                self._arrays[name][where] = getattr(rows, name)
        self._arrays["status"][where] = rows.status

    def stored(self, rows: slice) -> StoredRows:
        """What is stored of ``rows``.

        Raises:
            DatabaseError: damaged files, or pieces of written chunks that are missing.
        """
        read = StoredRows(**{name: self._read(name, rows) for name in layout(self.problem)})
        found, solved = read.found, read.status == Status.SOLVED
        whole = np.isfinite(read.cost[found]).all() and np.isfinite(read.z[found]).all()
        if not (whole and found[solved].any(axis=1).all()):
            raise DatabaseError(f"{self.path} is damaged: stored trajectories are missing; generate it again")
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
        present = self.present()[: -(-rows // self.chunk)]
        if not present.all():
            solved = int(present.sum()) * self.chunk
            raise DatabaseError(f"{self.path}: {solved} of the first {rows} instances are solved; generate the others")
        return np.sort(self._index_of_row[:rows])

    def solved(self, indices: Ints) -> Ints:
        """Those of ``indices`` whose instance has a solution."""
        return indices[(self._read("status") == Status.SOLVED)[self._row_of_index[indices]]]

    def samples(self, indices: ArrayLike | None = None) -> Samples:
        """The best solution of every instance that has one.

        Memory: the best solutions alone, in a file where they are many (:func:`~ocp_envs.support.arrays.scratch`), and
        a few thousand rows of all families while they are read.

        Args:
            indices: which instances, (K,), all by default; the samples are in this order.

        Raises:
            DatabaseError: damaged files.
        """
        wanted = np.arange(len(self)) if indices is None else np.asarray(indices, dtype=np.int64)
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
        status = self._read("status")
        present = status != MISSING
        record = {"problems": int(present.sum()), "solved": int((status == Status.SOLVED).sum())}
        return record | {name: int(self._read(name)[present].sum()) for name in COUNTS}

    def digest(self) -> str:
        """A hash of all arrays: equal for equal databases."""
        spans = [slice(begin, begin + _BLOCK) for begin in range(0, len(self), _BLOCK)]
        stored = (self._read(name, rows) for name in sorted(layout(self.problem)) for rows in spans)
        return _hash(chain([self.parameters, self._index_of_row], stored))


def _hash(parts: Iterable[NDArray[Any]]) -> str:
    sha = hashlib.sha256()
    for part in parts:
        sha.update(np.ascontiguousarray(part).tobytes())
    return sha.hexdigest()
