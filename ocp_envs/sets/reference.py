"""Shipped instances with their optimal costs: the development and validation sets, and the hard sets.

Each set is a table of :mod:`ocp_envs.tables` with the parameters and the best known cost of every solution family.
Parameters are stored rather than drawn again, so that they stay the same if a library changes its random numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ocp_envs import tables
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch
from ocp_envs.tables import path_of

SHIPPED = ("development", "validation")
#: Names of the sets of :mod:`ocp_envs.sets.hard_sets`; a problem without a discontinuity has no ``boundary``.
HARD = ("boundary", "outside", "near")
#: The splits on which methods are compared, in the order of tables and figures, each with the name of its set.
SPLITS = {"uniform": "validation", "boundary": "boundary", "near": "near", "outside": "outside"}


class ReferenceDataError(tables.TableError):
    """A reference file is missing, damaged or made for another problem."""


@checked
@dataclass(frozen=True, eq=False)
class ReferenceSet(Batch):
    """A set of instances with their optimal costs.

    Args:
        parameters: (M, np).
        mode_costs: best known cost of every solution family, +inf where none was found, (M, modes).

    Raises:
        ValueError: arrays of other shapes.
    """

    parameters: Array
    mode_costs: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        p, costs = np.shape(self.parameters), np.shape(self.mode_costs)
        if len(p) != 2 or len(costs) != 2 or p[0] != costs[0]:
            raise ValueError(f"expected parameters (M, np) and mode_costs (M, modes), got shapes {p} and {costs}")

    @property
    def cost(self) -> Array:
        """Best known cost, (M,)."""
        return np.asarray(self.mode_costs.min(axis=1))

    @property
    def mode(self) -> NDArray[np.int64]:
        """The family of the best known cost, (M,)."""
        return np.asarray(self.mode_costs.argmin(axis=1), dtype=np.int64)


def save(database: Database, split: str, folder: Path = tables.FOLDER) -> Path:
    """Write the instances and costs of ``database`` as the set ``split``; the path of the file.

    Args:
        database: of the set.
        split: name of the set, such as ``"validation"``.
        folder: of the tables of all problems.

    Raises:
        ReferenceDataError: an instance without a solution.
    """
    costs = database.costs()
    unsolved = int((~np.isfinite(costs).any(axis=1)).sum())
    if unsolved:
        raise ReferenceDataError(
            f"{database.path}: {unsolved} of {len(database)} instances have no solution to refer to"
        )
    return write(database.problem, split, ReferenceSet(database.parameters, costs), folder)


def write(problem: OptimalControlProblem, split: str, reference: ReferenceSet, folder: Path = tables.FOLDER) -> Path:
    """Write ``reference`` as the set ``split`` of ``problem`` into ``folder``; the path of the file."""
    return tables.save(problem, split, folder, parameters=reference.parameters, mode_costs=reference.mode_costs)


@checked
def load(problem: ProblemOrId, split: str, folder: Path = tables.FOLDER) -> ReferenceSet:
    """The shipped instances of ``problem`` with their optimal costs.

    Args:
        problem: the problem.
        split: ``"development"``, ``"validation"``, ``"boundary"``, ``"outside"`` or ``"near"``.
        folder: of the tables of all problems; by default those of the package.

    Raises:
        ReferenceDataError: no such file, damaged, or made for another problem.
    """
    problem = problem_of(problem)
    path = path_of(problem, split, Path(folder))
    if not path.is_file():
        there = sorted(p.stem for p in path.parent.glob("*.npz"))
        raise ReferenceDataError(f"no reference set {split!r} is shipped for {problem.id}; there are {there}")
    maker = "scripts/make_splits.py" if split in HARD else "scripts/generate_data.py --ship"
    try:
        arrays = cast("dict[str, Array]", tables.load(problem, split, folder, maker))
        found = ReferenceSet(arrays["parameters"], arrays["mode_costs"])
    except tables.TableError as error:
        raise ReferenceDataError(str(error)) from error
    except KeyError as error:
        raise ReferenceDataError(f"{path} is damaged or no reference file ({error} is missing)") from error
    except ValueError as error:
        raise ReferenceDataError(f"{path} is damaged or no reference file ({error})") from error
    got, expected = (
        (found.parameters.shape[1], found.mode_costs.shape[1]),
        (len(problem.parameters), len(problem.modes)),
    )
    if got != expected:
        raise ReferenceDataError(
            f"{path} has {got[0]} parameters and {got[1]} solution families, expected {expected[0]} and {expected[1]}; "
            f"make it again with {maker}"
        )
    return found


#: The public name of :func:`load` in ``ocp_envs``.
load_reference = load
