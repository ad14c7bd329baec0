"""Databases of optimal trajectories: a Zarr group on disk with one slot per problem and mode.

A slot holds the best trajectory found of its mode, with its cost; the winner of a problem, its cheapest slot, is
derived and never stored. Rows are written in chunks, each by one process and in one go, in a storage order that is part
of the file. A chunk exists once its piece of the array ``status``, which is written last, is there: whatever else an
interrupted run left behind is not seen, and overwritten later.

    parameters (M, np) and order (M,), the problem in every storage row, are there from the first moment.
    cost (M, modes), z (M, modes, flat), multipliers (M, modes, N, nh), attempts (M, statuses), status (M, modes)
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.codecs import ZstdCodec

from ocp_envs.nlp import Status
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import UnknownProblemError, load
from ocp_envs.records import provenance
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory

_FORMAT = "ocp_envs.database"
_VERSION = 1
#: Fill value of ``status``: rows that no chunk was written for.
_MISSING = -1


class DatabaseError(Exception):
    """A database that cannot be used as asked: not one, damaged, unfinished, or made for something else."""


@dataclass(frozen=True, eq=False)
class Slots:
    """What is stored of B problems.

    Args:
        cost: (B, modes), +inf where a slot is empty.
        status: (B, modes) int8, SOLVED or EMPTY; −1 for problems of an unfinished database that were not reached yet.
        z: flat trajectories, (B, modes, flat), NaN where empty.
        multipliers: of the path constraint at the knots, (B, modes, N, nh), NaN where empty.
        attempts: number of solves that ended in each :class:`Status`, (B, statuses).
    """

    cost: Array
    status: NDArray[np.int8]
    z: Array
    multipliers: Array
    attempts: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.cost)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which slots hold a trajectory, (B, modes)."""
        return self.status == Status.SOLVED


@dataclass(frozen=True, eq=False)
class Samples:
    """The winners of M solved problems.

    Args:
        problem: what was solved.
        parameters: (M, np).
        trajectory: M trajectories.
        cost: (M,).
        mode: (M,), indices into ``problem.modes.names``.
        multipliers: of the path constraint at the knots, (M, N, nh).
        mode_costs: the lowest cost found of every mode, (M, modes), +inf where none was.
        index: of each problem in its database, (M,).
    """

    problem: OptimalControlProblem
    parameters: Array
    trajectory: Trajectory
    cost: Array
    mode: NDArray[np.int64]
    multipliers: Array
    mode_costs: Array
    index: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.cost)

    def __getitem__(self, index: Any) -> Samples:
        """The samples at ``index`` (slice, mask or integer array; an integer keeps the batch axis)."""
        if isinstance(index, (int, np.integer)):
            index = slice(index, index + 1 or None)
        values = {f.name: getattr(self, f.name)[index] for f in dataclasses.fields(self) if f.name != "problem"}
        return Samples(self.problem, **values)


class Database:
    """Optimal trajectories of one problem for M parameters, on disk; see the module's text for the layout.

    Made by :meth:`create` or :meth:`open`. Any number of processes may read; one may write.
    """

    def __init__(self, path: Path, problem: OptimalControlProblem, group: zarr.Group) -> None:
        self.path, self.problem, self._group = path, problem, group
        attributes = dict(group.attrs)
        self.seed: int = attributes["seed"]
        self.settings: dict[str, Any] = attributes["settings"]
        self.provenance: dict[str, Any] = attributes["provenance"]
        self.chunk: int = attributes["chunk"]
        self.parameters: Array = self._read("parameters")
        self.order: NDArray[np.int64] = self._read("order")
        self._row = np.empty_like(self.order)
        self._row[self.order] = np.arange(len(self.order))

    # -- making and opening ----------------------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        problem: OptimalControlProblem,
        parameters: ArrayLike,
        *,
        chunk: int = 100,
        order: NDArray[np.int64] | None = None,
        seed: int = 0,
        settings: Mapping[str, Any] | None = None,
    ) -> Database:
        """A new database without any trajectories; it appears complete or not at all.

        Args:
            path: folder that does not exist yet, or is empty.
            problem: what will be solved.
            parameters: (M, np), M ≥ 1.
            chunk: problems written in one go.
            order: the problem in every storage row, a permutation of 0 … M−1; the given order by default.
            seed, settings: kept with the file; settings must be JSON.

        Raises:
            DatabaseError: there is something at ``path``.
        """
        path = Path(path)
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise DatabaseError(f"{path} exists already; open it with Database.open, or choose another path")
        values = problem.check_parameters(parameters, extrapolate=True)
        rows = np.arange(len(values)) if order is None else np.asarray(order, dtype=np.int64)
        if not len(values) or chunk < 1 or not np.array_equal(np.sort(rows), np.arange(len(values))):
            raise ValueError(
                f"expected at least one parameter, chunk ≥ 1 and an order that is a permutation; got {len(values)} "
                f"parameters, chunk {chunk}, an order of length {len(rows)}"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}-"))
        try:
            os.chmod(temporary, 0o755)
            group = zarr.create_group(temporary, zarr_format=3)
            group.create_array("parameters", data=values, chunks=values.shape)
            group.create_array("order", data=rows, chunks=rows.shape)
            for name, (shape, dtype, fill) in _layout(problem).items():
                group.create_array(
                    name,
                    shape=(len(values), *shape),
                    chunks=(min(chunk, len(values)), *shape),
                    dtype=dtype,
                    fill_value=fill,
                    compressors=ZstdCodec(level=3, checksum=True),
                )
            group.attrs.update(
                format=_FORMAT,
                version=_VERSION,
                problem=problem.id,
                fingerprint=problem.fingerprint,
                modes=list(problem.modes.names),
                chunk=chunk,
                seed=seed,
                settings=dict(settings or {}),
                provenance=provenance(),
            )
            os.replace(temporary, path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        return cls.open(path, problem, incomplete=True)

    @classmethod
    def open(
        cls, path: str | os.PathLike[str], problem: OptimalControlProblem | None = None, *, incomplete: bool = False
    ) -> Database:
        """The database at ``path``.

        Args:
            path: its folder.
            problem: what it must belong to; by default the known problem of the name in the file.
            incomplete: accept a database whose generation was interrupted.

        Raises:
            DatabaseError: no database there, a damaged or an unfinished one, or one of another problem.
        """
        path = Path(path)
        if not path.exists():
            raise DatabaseError(f"there is no database at {path}; make one with ocp_envs.generate")
        try:
            group = zarr.open_group(path, mode="r+", zarr_format=3)
            attributes = dict(group.attrs)
        except Exception as error:
            raise DatabaseError(f"{path} is not a database: {error or type(error).__name__}") from error
        if attributes.get("format") != _FORMAT:
            raise DatabaseError(f"{path} is not a database of trajectories")
        if attributes.get("version") != _VERSION:
            raise DatabaseError(
                f"{path} has version {attributes.get('version')} of the format, expected {_VERSION}; generate it anew"
            )
        problem = _owner(path, attributes, problem)
        try:
            database = cls(path, problem, group)
        except KeyError as error:
            raise DatabaseError(f"{path} is damaged: {error} is missing; generate it anew") from error
        database._check_layout()
        if not (incomplete or database.complete):
            done = int(database.done.sum())
            raise DatabaseError(
                f"{path} holds {done} of {len(database)} problems: its generation was interrupted; call generate with "
                "the same arguments to finish it, or open it with incomplete=True"
            )
        return database

    def _check_layout(self) -> None:
        expected = {name: (len(self), *shape) for name, (shape, _, _) in _layout(self.problem).items()}
        for name, shape in {**expected, "order": (len(self),), "parameters": self.parameters.shape}.items():
            if name not in self._group or self._array(name).shape != shape:
                raise DatabaseError(f"{self.path} is damaged: array {name!r} is missing or not of shape {shape}")

    # -- reading ---------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which problems were reached, (M,)."""
        return self._read("status")[self._row, 0] != _MISSING

    @property
    def complete(self) -> bool:
        """Whether all problems were reached."""
        return bool(self.done.all())

    def costs(self) -> tuple[Array, NDArray[np.int8]]:
        """Cost (M, modes) and status (M, modes) of all slots; see :class:`Slots`."""
        status = self._read("status")
        # A cost without its status belongs to a chunk that was not finished.
        cost = np.where(status == Status.SOLVED, self._read("cost"), np.inf)
        return cost[self._row], status[self._row]

    def attempts(self) -> NDArray[np.int32]:
        """Number of solves that ended in each :class:`Status`, (M, statuses)."""
        values = np.where(self._read("status")[:, :1] == _MISSING, 0, self._read("attempts"))
        return np.asarray(values[self._row], dtype=np.int32)

    def slots(self, indices: ArrayLike | None = None) -> Slots:
        """What is stored of the problems ``indices`` (all by default), in that order.

        Raises:
            DatabaseError: damaged files.
        """
        wanted = np.arange(len(self)) if indices is None else np.atleast_1d(np.asarray(indices))
        wanted = np.flatnonzero(wanted) if wanted.dtype == bool else wanted.astype(np.int64)
        result = _blank(self.problem, len(wanted))
        for places, values in self._chunks(wanted):
            for field in dataclasses.fields(Slots):
                getattr(result, field.name)[places] = getattr(values, field.name)
        return result

    def samples(self, indices: ArrayLike | None = None) -> Samples:
        """The winners of all problems (or of those at ``indices``) that have a solution, in order.

        Raises:
            DatabaseError: damaged files.
        """
        cost, _ = self.costs()
        index = np.arange(len(self)) if indices is None else np.arange(len(self))[np.asarray(indices)]
        index = index[np.isfinite(cost[index]).any(axis=1)]
        mode = cost[index].argmin(axis=1)
        problem, system = self.problem, self.problem.system
        z = np.empty((len(index), problem.flat_size))
        multipliers = np.empty((len(index), problem.knots, problem.n_clearances))
        for places, values in self._chunks(index):
            rows = np.arange(len(places))
            z[places] = values.z[rows, mode[places]]
            multipliers[places] = values.multipliers[rows, mode[places]]
        return Samples(
            problem=problem,
            parameters=self.parameters[index],
            trajectory=Trajectory.from_flat(z, problem.knots, system.nx, system.nu),
            cost=cost[index, mode],
            mode=mode,
            multipliers=multipliers,
            mode_costs=cost[index],
            index=index,
        )

    def _array(self, name: str) -> Any:
        return self._group[name]

    def _read(self, name: str, rows: slice = slice(None)) -> NDArray[Any]:
        try:
            return np.asarray(self._array(name)[rows])
        except KeyError:
            raise
        except Exception as error:  # whatever a codec makes of a damaged file
            raise DatabaseError(f"{self.path} is damaged: cannot read {name!r} ({error}); generate it anew") from error

    def _chunks(self, indices: NDArray[np.int64]) -> Iterator[tuple[NDArray[np.int64], Slots]]:
        """Places in ``indices`` and what is stored for them, one chunk after the other."""
        rows = self._row[indices]
        places = np.argsort(rows, kind="stable")
        starts = np.flatnonzero(np.diff(rows[places] // self.chunk, prepend=-1))
        for group in np.split(places, starts[1:]) if len(places) else []:
            first = rows[group[0]] // self.chunk * self.chunk
            values = self._read_chunk(slice(int(first), int(first) + self.chunk))
            yield group, Slots(*(getattr(values, f.name)[rows[group] - first] for f in dataclasses.fields(Slots)))

    def _read_chunk(self, rows: slice) -> Slots:
        status = self._read("status", rows)
        if (status == _MISSING).any():
            return _blank(self.problem, len(status), _MISSING)
        slots = Slots(**{f.name: self._read(f.name, rows) for f in dataclasses.fields(Slots) if f.name != "status"}, status=status)
        if not (np.isfinite(slots.z[slots.solved]).all() and np.isfinite(slots.cost[slots.solved]).all()):
            raise DatabaseError(f"{self.path} is damaged: trajectories are missing; generate it anew")
        return slots

    # -- writing ---------------------------------------------------------------------------------------------------

    def chunk_indices(self, chunk: int) -> NDArray[np.int64]:
        """The problems of a chunk."""
        return self.order[chunk * self.chunk : (chunk + 1) * self.chunk]

    def write(self, chunk: int, slots: Slots) -> None:
        """Write a whole chunk, problems in the order of :meth:`chunk_indices`; its status last."""
        rows = slice(chunk * self.chunk, chunk * self.chunk + len(slots))
        names = [field.name for field in dataclasses.fields(Slots) if field.name != "status"]
        for name in (*names, "status"):
            self._array(name)[rows] = getattr(slots, name)


def _layout(problem: OptimalControlProblem) -> dict[str, tuple[tuple[int, ...], Any, Any]]:
    """Shape without the first axis, type and fill value of every array that is written in chunks."""
    modes = len(problem.modes)
    return {
        "cost": ((modes,), np.float64, np.inf),
        "z": ((modes, problem.flat_size), np.float64, np.nan),
        "multipliers": ((modes, problem.knots, problem.n_clearances), np.float64, np.nan),
        "attempts": ((len(Status),), np.int32, 0),
        "status": ((modes,), np.int8, _MISSING),
    }


def _blank(problem: OptimalControlProblem, size: int, status: int = Status.EMPTY) -> Slots:
    """Empty slots of ``size`` problems."""
    arrays = {name: np.full((size, *s), fill, dtype=d) for name, (s, d, fill) in _layout(problem).items()}
    arrays["status"][:] = status
    return Slots(**arrays)


def _owner(path: Path, attributes: Mapping[str, Any], problem: OptimalControlProblem | None) -> OptimalControlProblem:
    """The problem a file belongs to."""
    name, fingerprint = attributes.get("problem"), attributes.get("fingerprint")
    if problem is None:
        try:
            problem = load(str(name))
        except UnknownProblemError as error:
            raise DatabaseError(
                f"{path} belongs to the problem {name!r}, which is not known here; register it first or pass it"
            ) from error
    if problem.id != name or problem.fingerprint != fingerprint:
        raise DatabaseError(
            f"{path} belongs to {name} with fingerprint {fingerprint}, not to {problem.id} with fingerprint "
            f"{problem.fingerprint}; generate it anew for this problem, or pass the one it was made for"
        )
    return problem
