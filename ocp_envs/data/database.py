"""Databases of optimal trajectories on disk, one slot for each mode of each problem.

A database is a Zarr group. Rows are stored in the order in which they were solved, ``order`` tells which parameter a
row belongs to; all public methods speak of parameters in the order in which they were given. Arrays share their chunks
along rows. A chunk of rows exists once its piece of ``status``, written last, is there; anything else is ignored and
written anew, so a process may be killed at any moment. Every piece is written in one step and carries a checksum.

    parameters (M, np), order (M,)           given
    status (M,)                              how a row ended: SOLVED where any mode was found, −1 before
    slot_status, cost (M, modes)             EMPTY and +inf where no trajectory of the mode was found
    z (M, modes, flat_size)                  the best trajectory of the mode, NaN where empty
    multipliers (M, modes, N, nh)            of the path constraint at the knots
    solves, failures, fallbacks, iterations (M,)  what it took, over all solves of the row
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec

from ocp_envs import problems
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Status
from ocp_envs.support import scratch
from ocp_envs.support.arrays import Array

FORMAT = "ocp-moe database"
VERSION = 1
#: Status of a row that is not there yet.
MISSING = -1
#: Rows of all modes that are held in memory at once.
_BLOCK = 5_000
_COUNTS = ("solves", "failures", "fallbacks", "iterations")


class DatabaseError(ValueError):
    """A database is missing, damaged, of another format, or made for something else."""


@dataclass(frozen=True, eq=False)
class Rows:
    """What is stored of B problems; see the module for the arrays."""

    status: NDArray[np.int8]
    slot_status: NDArray[np.int8]
    cost: Array
    z: Array
    multipliers: Array
    solves: NDArray[np.int32]
    failures: NDArray[np.int32]
    fallbacks: NDArray[np.int32]
    iterations: NDArray[np.int32]


class Database:
    """A database; made by :meth:`create` or :meth:`open`."""

    def __init__(self, path: Path, group: zarr.Group, problem: OptimalControlProblem) -> None:
        self.path, self.problem, self._group = path, problem, group
        self._arrays: dict[str, Any] = dict(group.arrays())
        self._order = np.asarray(self._read("order"))
        self._rank = np.argsort(self._order)

    # -- files -----------------------------------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        problem: OptimalControlProblem,
        parameters: ArrayLike,
        *,
        order: ArrayLike | None = None,
        settings: Mapping[str, Any] | None = None,
        chunk: int = 100,
    ) -> Database:
        """An empty database for ``parameters`` (M, np).

        Args:
            path: folder, must not exist.
            problem: what it is for.
            parameters: (M, np).
            order: which parameter each stored row belongs to, a permutation of 0 … M − 1.
            settings: what it is made with, as JSON.
            chunk: rows that are written at once.

        Raises:
            DatabaseError: the path exists.
            ValueError: unusable parameters, or an order that is no permutation.
        """
        target = Path(path)
        if target.exists():
            raise DatabaseError(f"{target} exists already; open it, or remove it first")
        p = problem.check_parameters(parameters, extrapolate=True)
        rows = np.arange(len(p)) if order is None else np.asarray(order, dtype=np.int64)
        if not np.array_equal(np.sort(rows), np.arange(len(p))):
            raise ValueError(f"order must be a permutation of 0 … {len(p) - 1}")
        temporary = target.with_name(f".{target.name}.{os.getpid()}")
        shutil.rmtree(temporary, ignore_errors=True)
        group = zarr.open_group(temporary, mode="w", zarr_format=3)
        group.attrs.update(
            {
                "format": FORMAT,
                "version": VERSION,
                "problem": problem.id,
                "fingerprint": problem.fingerprint,
                "modes": list(problem.modes.names),
                "chunk": chunk,
                "settings": dict(settings or {}),
            }
        )
        group.create_array("parameters", data=p)
        group.create_array("order", data=rows)
        for name, (shape, dtype, fill) in _layout(problem).items():
            group.create_array(
                name,
                shape=(len(p), *shape),
                chunks=(chunk, *(max(n, 1) for n in shape)),
                dtype=dtype,
                fill_value=fill,
                compressors=[ZstdCodec(level=1), Crc32cCodec()],
            )
        os.replace(temporary, target)
        return cls.open(target, problem)

    @classmethod
    def open(cls, path: str | os.PathLike[str], problem: OptimalControlProblem | None = None) -> Database:
        """The database at ``path``.

        Args:
            path: its folder.
            problem: what it is to be used for; by default the registered problem of the id it carries.

        Raises:
            DatabaseError: not a database, damaged, or made for another problem.
        """
        folder = Path(path)
        if not folder.is_dir():
            raise DatabaseError(f"there is no database at {folder}; make one with ocp_envs.generate")
        try:
            group = zarr.open_group(folder, mode="r+")
            attributes = dict(group.attrs)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DatabaseError(f"{folder} is not a database, or its description is damaged ({error})") from error
        if attributes.get("format") != FORMAT:
            raise DatabaseError(f"{folder} is not a database of this program: expected format {FORMAT!r}")
        if attributes.get("version") != VERSION:
            raise DatabaseError(
                f"{folder} has format version {attributes.get('version')!r}, this program reads {VERSION}; "
                "generate it anew"
            )
        if problem is None:
            problem = problems.load(str(attributes.get("problem")))
        found = (attributes.get("problem"), attributes.get("fingerprint"))
        if found != (problem.id, problem.fingerprint):
            raise DatabaseError(
                f"{folder} was made for {found[0]} with fingerprint {found[1]}, not for {problem.id} with "
                f"{problem.fingerprint}: the problem is another one or has changed since; generate it anew"
            )
        if list(modes := attributes.get("modes", [])) != list(problem.modes.names):
            raise DatabaseError(
                f"{folder} holds the modes {modes}, {problem.id} has {list(problem.modes.names)}: these were declared "
                "anew since; generate it anew"
            )
        missing = sorted({"parameters", "order", *_layout(problem)} - set(group.array_keys()))
        if missing:
            raise DatabaseError(f"{folder} is damaged: arrays {missing} are missing")
        return cls(folder, group, problem)

    def _read(self, name: str, rows: slice | None = None) -> NDArray[Any]:
        try:
            return np.asarray(self._arrays[name][rows or slice(None)])
        except (OSError, ValueError, RuntimeError, KeyError) as error:
            raise DatabaseError(f"{self.path} is damaged: {name} cannot be read ({error}); generate it anew") from error

    # -- writing ---------------------------------------------------------------------------------------------------

    @property
    def chunk(self) -> int:
        return int(self._group.attrs["chunk"])

    @property
    def settings(self) -> dict[str, Any]:
        """What it was made with."""
        return json.loads(json.dumps(self._group.attrs["settings"]))

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-len(self) // self.chunk)

    def stored_rows(self, chunk: int) -> slice:
        """The stored rows of chunk number ``chunk``."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, len(self)))

    def present(self) -> NDArray[np.bool_]:
        """Which chunks are there, (chunks,)."""
        return np.asarray(self._read("status")[:: self.chunk] != MISSING)

    def stored_parameters(self, rows: slice) -> Array:
        """Parameters of stored ``rows``."""
        return np.asarray(self.parameters[self._order[rows]])

    def write(self, chunk: int, rows: Rows) -> None:
        """Write chunk number ``chunk``; ``status`` goes last."""
        where = self.stored_rows(chunk)
        for name in _layout(self.problem):
            if name != "status":
                self._arrays[name][where] = getattr(rows, name)
        self._arrays["status"][where] = rows.status

    # -- reading ---------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self._order)

    @cached_property
    def parameters(self) -> Array:
        """All parameters in the order given, (M, np)."""
        return np.asarray(self._read("parameters"))

    @property
    def complete(self) -> bool:
        """Whether all chunks are there."""
        return bool(self.present().all())

    def stored(self, rows: slice) -> Rows:
        """Stored ``rows``, as they lie on disk.

        Raises:
            DatabaseError: damaged files, or pieces of finished chunks that are not there.
        """
        found = Rows(**{name: self._read(name, rows) for name in _layout(self.problem)})
        full = (found.slot_status == Status.SOLVED) & (found.status != MISSING)[:, None]
        solved = found.status == Status.SOLVED
        if not (np.isfinite(found.cost[full]).all() and np.isfinite(found.z[full]).all() and full[solved].any(1).all()):
            raise DatabaseError(f"{self.path} is damaged: stored trajectories are missing; generate it anew")
        return found

    def blocks(self, stop: int | None = None) -> Iterator[tuple[slice, Rows]]:
        """Stored rows 0 … ``stop`` (all by default), a few thousand at a time: memory is bounded whatever the size."""
        for rows in self._spans(len(self) if stop is None else stop):
            yield rows, self.stored(rows)

    def _spans(self, stop: int) -> Iterator[slice]:
        """Stored rows 0 … ``stop`` in whole chunks, a few thousand rows at a time."""
        step = self.chunk * max(1, _BLOCK // self.chunk)
        for begin in range(0, stop, step):
            yield slice(begin, min(begin + step, stop))

    def _blocks_of(self, places: NDArray[np.int64]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Rows]]:
        """Which of the stored rows ``places`` lie in a block, where in it, and the block; none is read in vain."""
        for span in self._spans(len(self)):
            wanted = np.flatnonzero((places >= span.start) & (places < span.stop))
            if len(wanted):
                yield wanted, places[wanted] - span.start, self.stored(span)

    def costs(self) -> Array:
        """The best cost of every mode of every problem, (M, modes); +inf where none was found."""
        return np.asarray(self._read("cost")[self._rank])

    def rows(self, indices: ArrayLike | None = None) -> Rows:
        """Everything that is stored of the parameters ``indices``, all by default: a copy of it all in memory."""
        chosen = self._rank if indices is None else self._rank[np.asarray(indices, dtype=np.int64)]
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in _layout(self.problem)}
        place = []
        for wanted, at, block in self._blocks_of(chosen):
            place.append(wanted)
            for name, part in parts.items():
                part.append(getattr(block, name)[at])
        back = np.argsort(np.concatenate(place))
        return Rows(**{name: np.concatenate(part)[back] for name, part in parts.items()})

    def first(self, count: int | None) -> NDArray[np.int64]:
        """The ``count`` parameters that are solved first, in their order; all where ``None``.

        They are random ones, and there long before the database is complete.

        Raises:
            DatabaseError: they are not there yet.
        """
        rows = len(self) if count is None else min(count, len(self))
        there = self.present()[: -(-rows // self.chunk)]
        if not there.all():
            raise DatabaseError(
                f"{self.path}: {int(there.sum()) * self.chunk} of the first {rows} problems are there; generate the "
                "others first"
            )
        return np.sort(self._order[:rows])

    def solved(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of the parameters ``indices`` that have a solution."""
        return indices[(self._read("status") == Status.SOLVED)[self._rank[indices]]]

    def samples(self, indices: ArrayLike | None = None) -> Samples:
        """The best solution of every parameter in ``indices`` (all by default) that has one, in their order.

        Memory: the winners alone, in a file where they are many (:mod:`ocp_envs.support.scratch`), and a few thousand
        rows of all modes while they are read.
        """
        wanted = np.arange(len(self)) if indices is None else np.asarray(indices, dtype=np.int64)
        index = self.solved(wanted)
        cost = self.costs()[index]
        mode = np.asarray(cost.argmin(axis=1), dtype=np.int64)
        problem, place = self.problem, self._rank[index]
        z = scratch.empty((len(index), problem.flat_size))
        multipliers = np.empty((len(index), problem.knots, problem.n_clearances))
        for wanted_here, at, block in self._blocks_of(place):
            slot = at, mode[wanted_here]
            z[wanted_here], multipliers[wanted_here] = block.z[slot], block.multipliers[slot]
        return Samples(
            problem=problem,
            parameters=self.parameters[index],
            trajectory=problem.unflatten(z),
            cost=cost[np.arange(len(index)), mode],
            mode=mode,
            multipliers=multipliers,
            mode_costs=cost,
            index=index,
        )

    def totals(self) -> dict[str, int]:
        """Sums over all problems that are there: problems, solved ones, solves, failures, fallbacks, iterations."""
        status = self._read("status")
        there = status != MISSING
        record = {"problems": int(there.sum()), "solved": int((status == Status.SOLVED).sum())}
        return record | {name: int(self._read(name)[there].sum()) for name in _COUNTS}

    @property
    def key(self) -> str:
        """A hash of problem, settings and parameters: of all that decides what a finished database holds."""
        record = [self.problem.fingerprint, self._group.attrs["settings"]]
        sha = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
        sha.update(np.ascontiguousarray(self.parameters).tobytes())
        return sha.hexdigest()

    def digest(self) -> str:
        """A hash of all arrays: equal for equal databases."""
        sha = hashlib.sha256()
        sha.update(np.ascontiguousarray(self.parameters).tobytes())
        sha.update(np.ascontiguousarray(self._order).tobytes())
        for name in sorted(_layout(self.problem)):
            for begin in range(0, len(self), _BLOCK):
                sha.update(np.ascontiguousarray(self._read(name, slice(begin, begin + _BLOCK))).tobytes())
        return sha.hexdigest()


def _layout(problem: OptimalControlProblem) -> dict[str, tuple[tuple[int, ...], str, float]]:
    """Shape of a row, type and value before writing, of every array."""
    modes = len(problem.modes)
    layout: dict[str, tuple[tuple[int, ...], str, float]] = {
        "status": ((), "int8", MISSING),
        "slot_status": ((modes,), "int8", Status.EMPTY),
        "cost": ((modes,), "float64", np.inf),
        "z": ((modes, problem.flat_size), "float64", np.nan),
        "multipliers": ((modes, problem.knots, problem.n_clearances), "float64", np.nan),
    }
    return layout | {name: ((), "int32", 0) for name in _COUNTS}
