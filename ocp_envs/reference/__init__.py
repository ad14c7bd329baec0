"""Shipped parameters and reference costs of the development and validation sets.

One file ``<env-id>/<split>.npz`` a set, arrays without pickle: the parameters, and the best known cost of every mode.
Parameters are stored rather than drawn again, so that they stay the same whatever a library's random numbers become.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ocp_envs.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Array

FOLDER = Path(__file__).parent
SHIPPED = ("development", "validation")


class ReferenceDataError(ValueError):
    """A reference file is missing, damaged or made for another problem."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A set of problems with known optimal costs.

    Args:
        parameters: (M, np).
        mode_costs: best known cost of every mode, +inf where none was found, (M, modes).
    """

    parameters: Array
    mode_costs: Array

    @property
    def cost(self) -> Array:
        """Best known cost, (M,)."""
        return np.asarray(self.mode_costs.min(axis=1))

    @property
    def mode(self) -> NDArray[np.int64]:
        """The mode that has it, (M,)."""
        return np.asarray(self.mode_costs.argmin(axis=1), dtype=np.int64)

    def __len__(self) -> int:
        return len(self.parameters)


def path_of(problem: OptimalControlProblem, split: str, folder: Path = FOLDER) -> Path:
    """The file of a set."""
    return folder / problem.id / f"{split}.npz"


def save(database: Database, split: str, folder: Path = FOLDER) -> Path:
    """Write the reference of ``database``, in one step.

    Raises:
        ReferenceDataError: a problem without a solution.
    """
    costs = database.costs()
    unsolved = int((~np.isfinite(costs).any(axis=1)).sum())
    if unsolved:
        raise ReferenceDataError(
            f"{database.path}: {unsolved} of {len(database)} problems have no solution to refer to"
        )
    target = path_of(database.problem, split, folder)
    target.parent.mkdir(parents=True, exist_ok=True)
    descriptor, temporary = tempfile.mkstemp(dir=target.parent, suffix=".npz")
    with os.fdopen(descriptor, "wb") as file:
        np.savez_compressed(
            file,
            parameters=database.parameters,
            mode_costs=costs,
            fingerprint=np.array(database.problem.fingerprint),
        )
    os.chmod(temporary, 0o644)
    os.replace(temporary, target)
    return target


def load(problem: OptimalControlProblem, split: str, folder: Path = FOLDER) -> Reference:
    """The shipped set ``split`` of ``problem``.

    Raises:
        ReferenceDataError: no such file, damaged, or made for another problem.
    """
    path = path_of(problem, split, folder)
    if not path.is_file():
        there = sorted(p.stem for p in path.parent.glob("*.npz"))
        raise ReferenceDataError(f"no reference {split!r} is shipped for {problem.id}; there are {there}")
    try:
        with np.load(path, allow_pickle=False) as file:
            fingerprint = str(file["fingerprint"])
            reference = Reference(file["parameters"], file["mode_costs"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise ReferenceDataError(f"{path} is damaged or no reference file ({error})") from error
    if fingerprint != problem.fingerprint:
        raise ReferenceDataError(
            f"{path} was made for a problem with fingerprint {fingerprint}, {problem.id} has {problem.fingerprint}: "
            "the problem has changed since; make the reference anew with scripts/generate_data.py --ship"
        )
    return reference
