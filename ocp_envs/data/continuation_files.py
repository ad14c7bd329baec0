"""What continuation says of pairs of neighbours, on disk: a Zarr group of its own, in chunks that exist or do not.

    distance, excess (E, 2)    at j from the optimum of i, and at i from the optimum of j
    iterations (E, 2)          of the solver

A chunk exists once its pieces of all arrays do. Each piece is written in one step, with a checksum, so a process may be
killed at any moment. The group says, with a checksum, of which samples it is.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ocp_envs.data.array_files import ArrayFiles
from ocp_envs.data.description import read_attributes, write_attributes
from ocp_envs.data.layout import Column, DatabaseError
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.files import rename_folder
from ocp_envs.support.rows import Batch

FORMAT, VERSION = "ocp-moe continuation", 1
#: Pairs that are solved in one task and written in one step.
CHUNK = 500
_NAMES = ("distance", "excess", "iterations")
_CURE = "remove it, and it is made again"


def _columns() -> dict[str, Column]:
    """The arrays by name."""
    return {
        "distance": Column((2,), "float32", np.nan, CHUNK),
        "excess": Column((2,), "float32", np.nan, CHUNK),
        "iterations": Column((2,), "int32", 0, CHUNK),
    }


@dataclass(frozen=True, eq=False)
class Continued(Batch):
    """How both solves of B pairs ended: ``distance``, ``excess`` of the cost and ``iterations``, each (B, 2)."""

    distance: NDArray[np.float32]
    excess: NDArray[np.float32]
    iterations: NDArray[np.int32]


class ContinuationFiles:
    """The results of ``count`` pairs in the folder ``path``.

    Raises:
        DatabaseError: damaged files.
    """

    def __init__(self, path: Path, count: int) -> None:
        self.path, self._count = path, count
        self._files = ArrayFiles(path, _columns(), [count])

    @classmethod
    def open_or_create(cls, path: Path, problem: OptimalControlProblem, key: str, count: int) -> ContinuationFiles:
        """The results at ``path`` of ``count`` pairs of samples of ``problem``; new ones where there are none.

        ``key`` is a hash of everything that they depend on.

        Raises:
            DatabaseError: something else lies there, or damaged files.
        """
        expected: dict[str, object] = {
            "format": FORMAT,
            "version": VERSION,
            "problem": problem.id,
            "fingerprint": problem.fingerprint,
            "key": key,
            "pairs": count,
        }
        if not path.exists():
            temporary = path.with_name(f".{path.name}.{os.getpid()}")
            shutil.rmtree(temporary, ignore_errors=True)
            write_attributes(temporary, expected)
            ArrayFiles.create(temporary, _columns(), count)
            rename_folder(temporary, path)
        found = read_attributes(path)
        if wrong := sorted(name for name, value in expected.items() if found.get(name) != value):
            name = wrong[0]
            got = f"got {name} {found.get(name)!r:.99}, expected {expected[name]!r}"
            raise DatabaseError(f"{path} is not the continuation of these samples: {got}; {_CURE}")
        return cls(path, count)

    def rows(self, number: int) -> slice:
        """The pairs of the chunk ``number``."""
        return slice(number * CHUNK, min((number + 1) * CHUNK, self._count))

    def missing(self) -> list[int]:
        """The numbers of the chunks that do not exist."""
        numbers = range(-(-self._count // CHUNK))
        return [n for n in numbers if not all(self._files.exist(name, self.rows(n)) for name in _NAMES)]

    def write(self, number: int, found: Continued) -> None:
        """Write ``found`` as the chunk ``number``; it is on the disk when this returns."""
        for name in _NAMES:
            self._files.write(name, self.rows(number), getattr(found, name))

    def read(self) -> Continued:
        """The results of all pairs.

        Raises:
            DatabaseError: damaged files.
        """
        whole = slice(0, self._count)
        return Continued(*(self._files.read(name, whole) for name in _NAMES))
