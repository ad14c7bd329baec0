"""Layout of a database in a Zarr group: its arrays, and what a folder must hold to be one.

    parameters (M, np), order (M,)           given
    status (M,)                              how a row ended: SOLVED where any family was found, MISSING before
    slot_status, cost (M, modes)             EMPTY and +inf where no trajectory of the family was found
    z (M, modes, flat_size)                  the best trajectory of the family, NaN where empty
    multipliers (M, modes, N, nh)            of the path constraint at the knots
    solves, failures, fallbacks, iterations (M,)  solver statistics, over all solves of the row

The arrays share their chunks along rows. A chunk of rows exists once its piece of ``status``, written last, exists;
anything else is ignored and written again, so a process may be killed at any moment. Every piece is written in one step
and carries a checksum.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec

from ocp_envs import problems
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.files import rename_folder
from ocp_envs.support.rows import Batch

FORMAT = "ocp-moe database"
VERSION = 1
#: Status of a row that was not written yet.
MISSING = -1
#: The solver statistics.
COUNTS = ("solves", "failures", "fallbacks", "iterations")


class DatabaseError(ValueError):
    """A database is missing, damaged, of another format, or made for something else."""


@dataclass(frozen=True, eq=False)
class StoredRows(Batch):
    """What is stored of B instances: how each row ended, ``status`` (B,), and the best trajectory of every family.

    ``slot_status`` (B, modes) says whether one was found; ``cost`` (B, modes), ``z`` (B, modes, flat_size) in the flat
    layout and ``multipliers`` (B, modes, N, nh) of the path constraint at the knots are its own. The solver statistics,
    (B,), are the number of ``solves``, the ``failures`` and ``fallbacks`` among them, and all their ``iterations``.
    """

    status: NDArray[np.int8]
    slot_status: NDArray[np.int8]
    cost: Array
    z: Array
    multipliers: Array
    solves: NDArray[np.int32]
    failures: NDArray[np.int32]
    fallbacks: NDArray[np.int32]
    iterations: NDArray[np.int32]

    @property
    def present(self) -> Bools:
        """Which rows were written, (B,). An interrupted chunk may hold costs and trajectories that do not count."""
        return self.status != MISSING

    @property
    def found(self) -> Bools:
        """Which families of which rows have a trajectory, (B, modes)."""
        return (self.slot_status == Status.SOLVED) & self.present[:, None]


class Column(NamedTuple):
    """An array of the layout: shape of a row, type, and value before it is written."""

    shape: tuple[int, ...]
    dtype: str
    fill: float


def layout(problem: OptimalControlProblem) -> dict[str, Column]:
    """The arrays of solved rows of ``problem``, by name."""
    modes = len(problem.modes)
    return {
        "status": Column((), "int8", MISSING),
        "slot_status": Column((modes,), "int8", Status.EMPTY),
        "cost": Column((modes,), "float64", np.inf),
        "z": Column((modes, problem.flat_size), "float64", np.nan),
        "multipliers": Column((modes, problem.knots, problem.n_clearances), "float64", np.nan),
        **{name: Column((), "int32", 0) for name in COUNTS},
    }


def create_group(
    path: Path,
    problem: OptimalControlProblem,
    parameters: Array,
    order: Ints,
    settings: Mapping[str, object],
    chunk: int,
) -> None:
    """Write the files of an empty database to the folder ``path``, in one step.

    It is for the instances of ``problem`` with ``parameters`` (M, np), in the ``order`` (M,) of rows, made with
    ``settings`` (JSON); ``chunk`` rows are written at a time.

    Raises:
        DatabaseError: the path exists.
    """
    if path.exists():
        raise DatabaseError(f"{path} exists already; open it, or remove it first")
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    shutil.rmtree(temporary, ignore_errors=True)
    group = zarr.open_group(temporary, mode="w", zarr_format=3)
    description = {"format": FORMAT, "version": VERSION, "problem": problem.id, "fingerprint": problem.fingerprint}
    group.attrs.update({**description, "modes": list(problem.modes.names), "chunk": chunk, "settings": dict(settings)})
    group.create_array("parameters", data=parameters)
    group.create_array("order", data=order)
    for name, column in layout(problem).items():
        group.create_array(
            name,
            shape=(len(parameters), *column.shape),
            chunks=(chunk, *(max(n, 1) for n in column.shape)),
            dtype=column.dtype,
            fill_value=column.fill,
            compressors=[ZstdCodec(level=1), Crc32cCodec()],
        )
    rename_folder(temporary, path)


def open_group(path: Path, problem: OptimalControlProblem | None) -> tuple[zarr.Group, OptimalControlProblem]:
    """The group in the folder ``path``, and the problem it was made for.

    This must be ``problem``; where ``None``, it is the registered problem of the id that the database carries.

    Raises:
        DatabaseError: not a database, damaged, or made for another problem.
    """
    if not path.is_dir():
        raise DatabaseError(f"there is no database at {path}; make one with ocp_envs.generate")
    try:
        group = zarr.open_group(path, mode="r+")
        attributes = dict(group.attrs)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatabaseError(f"{path} is not a database, or its description is damaged ({error})") from error
    found, version = attributes.get("format"), attributes.get("version")
    if found != FORMAT:
        raise DatabaseError(f"{path} is not a database of this program: got format {found!r}, expected {FORMAT!r}")
    if version != VERSION:
        raise DatabaseError(f"{path} has format version {version!r}, expected {VERSION}; generate it again")
    if problem is None:
        problem = problems.load(str(attributes.get("problem")))
    _check_made_for(problem, path, attributes)
    missing = sorted({"parameters", "order", *layout(problem)} - set(group.array_keys()))
    if missing:
        raise DatabaseError(f"{path} is damaged: arrays {missing} are missing; generate it again")
    return group, problem


def _check_made_for(problem: OptimalControlProblem, path: Path, attributes: Mapping[str, object]) -> None:
    """Raise where the database with these ``attributes`` was made for something other than ``problem``."""
    found = attributes.get("problem"), attributes.get("fingerprint")
    if found != (problem.id, problem.fingerprint):
        raise DatabaseError(
            f"{path} was made for {found[0]} with fingerprint {found[1]}, not for {problem.id} with "
            f"{problem.fingerprint}: the problem is another one or has changed since; generate it again"
        )
    modes, expected = attributes.get("modes"), list(problem.modes.names)
    if modes != expected:
        raise DatabaseError(
            f"{path} holds the solution families {modes}, {problem.id} has {expected}: their declaration has changed "
            "since; generate it again"
        )
