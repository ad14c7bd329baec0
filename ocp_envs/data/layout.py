"""Layout of a database: a Zarr group in a folder, with these arrays.

    parameters (M, np), order (M,)           given
    status (M,)                              how a row ended: SOLVED where any family was found, MISSING before
    slot_status, cost (M, modes)             EMPTY and +inf where no trajectory of the family was found
    z (M, modes, flat_size)                  the best trajectory of the family, NaN where empty
    multipliers (M, modes, N, nh)            of the path constraint at the knots
    solves, failures, fallbacks, iterations (M,)  solver statistics, over all solves of the row

Every array is stored in pieces of a fixed number of rows, each written in one step, with a checksum. The pieces of
solved rows are chunks; a chunk of rows exists once its piece of ``status``, written last, and all others exist.
Anything else is ignored and written again, so a process may be killed at any moment. In a finished database everything
exists. Databases of format version 1 have no checksums of ``parameters`` and ``order``, and pieces that would hold
nothing but initial values were not written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch

#: Status of a row that was not written yet.
MISSING = -1
#: The solver statistics.
COUNTS = ("solves", "failures", "fallbacks", "iterations")
#: What cures every damage.
CURE = "restore it from a copy, or generate the database again"
#: Rows in a piece of the arrays that are given: few pieces, for they are read whole.
_GIVEN = 10_000


class DatabaseError(ValueError):
    """A database is missing, damaged, of another format, or made for something else."""


@checked
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
    """An array of the layout: shape of a row, type, value before it is written, and rows in a piece.

    ``piece`` is ``None`` where an earlier version let Zarr choose it, and the codecs.
    """

    shape: tuple[int, ...]
    dtype: str
    fill: float
    piece: int | None


def layout(problem: OptimalControlProblem, chunk: int) -> dict[str, Column]:
    """The arrays of solved rows of ``problem``, by name, in pieces of ``chunk`` rows."""
    modes = len(problem.modes)
    return {
        "slot_status": Column((modes,), "int8", Status.EMPTY, chunk),
        "cost": Column((modes,), "float64", np.inf, chunk),
        "z": Column((modes, problem.flat_size), "float64", np.nan, chunk),
        "multipliers": Column((modes, problem.knots, problem.n_clearances), "float64", np.nan, chunk),
        **{name: Column((), "int32", 0, chunk) for name in COUNTS},
        "status": Column((), "int8", MISSING, chunk),
    }


def given(problem: OptimalControlProblem, version: int) -> dict[str, Column]:
    """The arrays that a database of ``problem`` is made from, by name, in the format ``version``."""
    piece = None if version == 1 else _GIVEN
    return {
        "parameters": Column((len(problem.parameters),), "float64", 0, piece),
        "order": Column((), "int64", 0, piece),
    }
