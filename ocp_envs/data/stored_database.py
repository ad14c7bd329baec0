"""Databases of optimal trajectories on disk, row by row: made, opened, written and grown.

Three numbers belong to an instance:

    index i   its position in the parameters as they were given (arguments named ``indices``).
    row r     its position on disk, in the order in which the instances are solved (arguments named ``rows``).
              The array ``order`` holds the index of each row, i = order[r]; its inverse holds the row of each index.
    chunk     ⌊r / rows per chunk⌋: the rows of a chunk are solved in one task and written in one step.

What lies on disk is described in :mod:`ocp_envs.data.layout`. A finished database can grow: new instances get the next
rows, and what is there stays as it is. Their first rows complete the last chunk, and are then a task of their own.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs import problems
from ocp_envs.data.array_files import ArrayFiles
from ocp_envs.data.description import Description, read_description, write_description
from ocp_envs.data.layout import CURE, MISSING, DatabaseError, StoredRows, given, layout
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.doors import checked
from ocp_envs.support.files import rename_folder, sync_everything


class StoredDatabase:
    """A database on disk, row by row; :meth:`create` makes a new one, :meth:`open` opens an existing one.

    It lies in the folder ``path`` and was made for ``problem``.

    Raises:
        DatabaseError: not a database, damaged, or made for another problem.
    """

    @checked
    def __init__(self, path: Path, problem: ProblemOrId) -> None:
        path, problem = Path(path), problem_of(problem)
        description = read_description(path)
        description.check_made_for(problem, path)
        self.path, self.problem, self._description = path, problem, description
        made_from, self._columns = given(problem, description.version), layout(problem, description.chunk)
        sizes = {description.size, description.growing or description.size}
        self._files = ArrayFiles(path, made_from | self._columns, sorted(sizes))
        for name in made_from:  # version 1 did not write one row of zeros
            if not self._files.exist(name, slice(0, len(self))) and (len(self) > 1 or description.version > 1):
                raise DatabaseError(f"{path} is damaged: pieces of {name} are missing; {CURE}")
        self._index_of_row: Ints = self._read("order")
        if not np.array_equal(np.sort(self._index_of_row), np.arange(len(self))):
            raise DatabaseError(f"{path} is damaged: order is no permutation of its rows; {CURE}")
        self._row_of_index: Ints = np.argsort(self._index_of_row)
        self._exist = self._find()
        if not self._exist[: description.safe].all():
            raise DatabaseError(f"{path} is damaged: pieces of solved rows are missing; {CURE}")

    def __repr__(self) -> str:
        found = f"{np.count_nonzero(self._exist)} of {len(self)} instances"
        return f"<{type(self).__name__} {str(self.path)!r} of {self.problem.id!r}: {found}>"

    @classmethod
    @checked
    def create(
        cls,
        path: str | os.PathLike[str],
        problem: ProblemOrId,
        parameters: ArrayLike,
        *,
        order: ArrayLike | None = None,
        settings: Mapping[str, object] | None = None,
        chunk: int = 100,
    ) -> Self:
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
            ValueError: parameters of the wrong shape or not finite, an order that is no permutation, or no rows that
                are written at a time.
        """
        problem = problem_of(problem)
        p, target = problem.check_parameters(parameters, extrapolate=True), Path(path)
        rows = _permutation(np.arange(len(p)) if order is None else order, 0, len(p))
        if target.exists():
            raise DatabaseError(f"{path} exists already; open it, or remove it first")
        description = Description(
            problem=problem.id,
            fingerprint=problem.fingerprint,
            modes=list(problem.modes.names),
            chunk=chunk,
            settings=dict(settings or {}),
            sizes=[len(p)],
        )
        temporary = target.with_name(f".{target.name}.{os.getpid()}")
        shutil.rmtree(temporary, ignore_errors=True)
        write_description(temporary, description)
        files = ArrayFiles.create(temporary, given(problem, description.version) | layout(problem, chunk), len(p))
        files.write("parameters", slice(0, len(p)), p)
        files.write("order", slice(0, len(p)), rows)
        rename_folder(temporary, target)
        return cls.open(path, problem)

    @classmethod
    @checked
    def open(cls, path: str | os.PathLike[str], problem: ProblemOrId | None = None) -> Self:
        """The database in the folder ``path``, made for ``problem``; by default for the registered one of its id.

        Raises:
            DatabaseError: not a database, damaged, or made for another problem.
        """
        problem = None if problem is None else problem_of(problem)
        folder = Path(path)
        if not folder.is_dir():
            raise DatabaseError(f"there is no database at {path}; make one with ocp_envs.generate")
        return cls(folder, problems.load(read_description(folder).problem) if problem is None else problem)

    @checked
    def grow(self, parameters: ArrayLike, order: ArrayLike) -> Self:
        """This database with room for further instances, whose rows do not exist yet; those of the others stay.

        A process may be killed meanwhile: until the new instances are complete, the database has its old ones.

        Args:
            parameters: of the new instances, (K, np), whose indices follow those of the others.
            order: index of each new row, a permutation of M … M + K − 1.

        Raises:
            DatabaseError: it is not finished, or has the format version 1.
            ValueError: parameters of the wrong shape or not finite, or an order that is no permutation.
        """
        p, size = self.problem.check_parameters(parameters, extrapolate=True), len(self)
        new, index = slice(size, size + len(p)), _permutation(order, size, len(p))
        if not self._description.finished:
            reason = "has format version 1" if self._description.version == 1 else "is not finished"
            raise DatabaseError(f"{self.path} {reason} and cannot grow; generate it first, or choose another path")
        if self._description.growing is not None:  # the process that prepared this was killed
            self._files.resize(size)
        self._describe(growing=new.stop)
        self._files.resize(new.stop)
        self._files.write("parameters", new, p)
        self._files.write("order", new, index)
        self._describe(sizes=[*self._description.sizes, new.stop], growing=None, finished=False)
        return self.open(self.path, self.problem)

    def _read(self, name: str, rows: slice | None = None) -> NDArray[Any]:
        return self._files.read(name, rows or slice(0, len(self)))

    def __len__(self) -> int:
        return self._description.size

    @cached_property
    def parameters(self) -> Array:
        """Parameters of all instances by index, (M, np)."""
        parameters = self._read("parameters")
        if not np.isfinite(parameters).all():
            raise DatabaseError(f"{self.path} is damaged: its parameters are not finite; {CURE}")
        return parameters

    @property
    def order(self) -> Ints:
        """The index of each row, (M,)."""
        return self._index_of_row

    @property
    def settings(self) -> dict[str, object]:
        """The settings it was made with, as JSON."""
        return json.loads(json.dumps(self._description.settings))

    @property
    def chunk(self) -> int:
        """Number of rows in a chunk; the last chunk may have fewer."""
        return self._description.chunk

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

    def missing_rows(self, chunk: int) -> slice:
        """The rows of the chunk with number ``chunk`` that do not exist: all or none, or what has grown."""
        rows = self.stored_rows(chunk)
        return slice(rows.start + int(self._exist[rows].sum()), rows.stop)

    def present(self) -> Bools:
        """Which chunks exist, (chunks,)."""
        return np.array([self._exist[self.stored_rows(chunk)].all() for chunk in range(self.chunks)], dtype=bool)

    @property
    def complete(self) -> bool:
        """Whether all chunks exist."""
        return bool(self._exist.all())

    def _find(self) -> Bools:
        """Which rows exist, (M,): those with a status whose chunk has all its pieces."""
        found = self._read("status") != MISSING
        if self._description.version == 1:
            return found
        for chunk in range(self.chunks):
            rows = self.stored_rows(chunk)
            if found[rows].any():
                found[rows] &= all(self._files.exist(name, rows) for name in self._columns)
        return found

    def write(self, chunk: int, rows: StoredRows) -> None:
        """Write ``rows`` as the chunk with number ``chunk``, or as its last rows where it has grown.

        They are on the disk when this returns; the names of new files may follow until the last chunk finishes the
        database.

        Raises:
            DatabaseError: rows that are there already are damaged.
            ValueError: more rows than the chunk has, or none.
        """
        whole = self.stored_rows(chunk)
        where = slice(whole.stop - len(rows), whole.stop)
        if not whole.start <= where.start < where.stop:
            raise ValueError(f"chunk {chunk} has {whole.stop - whole.start} rows, got {len(rows)}")
        for name in self._columns:  # ``status`` goes last
            self._files.write(name, where, getattr(rows, name))
        self._exist[where] = rows.present
        if self.complete and not self._description.finished and self._description.version > 1:
            sync_everything()
            self._describe(finished=True)

    def _describe(self, **changes: Any) -> None:
        """Change what the database says of itself."""
        self._description = dataclasses.replace(self._description, **changes)
        write_description(self.path, self._description)


def _permutation(order: ArrayLike, begin: int, count: int) -> Ints:
    """The ``order`` as integers, where it is a permutation of ``count`` indices from ``begin``."""
    index = np.asarray(order, dtype=np.int64)
    if not np.array_equal(np.sort(index, axis=None), np.arange(begin, begin + count)) or index.ndim != 1:
        raise ValueError(f"order must be a permutation of {begin} … {begin + count - 1}")
    return index
