"""Tables that the package carries: arrays of a problem in ``reference/<env-id>/<name>.npz``, without pickle."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.support.archives import DamagedFileError, read_arrays, write_arrays
from ocp_envs.support.arrays import Array, frozen_array

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

FOLDER = Path(__file__).parent / "reference"
STARTS = "starts"


class TableError(ValueError):
    """A table is missing, damaged or made for another problem."""


def path_of(problem: OptimalControlProblem, name: str, folder: Path = FOLDER) -> Path:
    """The file of the table ``name`` of ``problem`` below ``folder``."""
    return folder / problem.id / f"{name}.npz"


def save(problem: OptimalControlProblem, name: str, folder: Path = FOLDER, **arrays: ArrayLike) -> Path:
    """Write ``arrays`` as the table ``name`` of ``problem`` below ``folder``, atomically; the path of the file."""
    target = path_of(problem, name, folder)
    write_arrays(target, {"fingerprint": np.array(problem.fingerprint), **arrays})
    return target


def load(
    problem: OptimalControlProblem, name: str, folder: Path = FOLDER, maker: str = "scripts/make_starts.py"
) -> dict[str, NDArray[np.generic]]:
    """The arrays of the table ``name`` of ``problem``.

    Args:
        problem: the problem.
        name: of the table.
        folder: of the tables of all problems.
        maker: the script that makes the table, for messages.

    Raises:
        TableError: no such file, damaged, or made for another problem.
    """
    path = path_of(problem, name, folder)
    if not path.is_file():
        raise TableError(f"no table {name!r} is shipped for {problem.id}; {maker} makes one")
    try:
        arrays = read_arrays(path)
        fingerprint = str(arrays.pop("fingerprint"))
    except (DamagedFileError, KeyError) as error:
        raise TableError(
            f"{path} is damaged or no table ({error}); restore it, or make it again with {maker}"
        ) from error
    if fingerprint != problem.fingerprint:
        raise TableError(
            f"{path} was made for a problem with fingerprint {fingerprint}, {problem.id} has {problem.fingerprint}: "
            f"the problem has changed since; make the table again with {maker}"
        )
    return arrays


@lru_cache(maxsize=32)
def starts(problem: OptimalControlProblem) -> Array:
    """Parameters from which the environment of ``problem`` draws where exact draws need solutions, (M, np).

    Raises:
        TableError: there are none.
    """
    try:
        parameters = load(problem, STARTS)["parameters"]
    except (TableError, KeyError) as error:
        raise TableError(
            f"{problem.id} draws its parameters from a table, and there is none to use ({error}); pass "
            'options={"parameters": p} to reset(), or make the table'
        ) from error
    return frozen_array(problem.check_parameters(parameters))
