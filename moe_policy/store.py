"""Planners and policies by name: those in the package, and those that the user saved.

Modules are imported when a model of theirs is loaded, so that nothing waits for a library that it does not use.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar, overload

from moe_policy.checking import shipped as checking
from moe_policy.model_files import ModelFile, ModelFileError, read_model
from moe_policy.protocols import Policy
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.doors import checked
from ocp_envs.support.suggestions import did_you_mean

if TYPE_CHECKING:
    from typing import TypeAlias

    from moe_policy.checking.checked import Checked
    from moe_policy.control.stabiliser import Stabiliser
    from moe_policy.planners.nearest import NearestPlanner
    from moe_policy.planners.network import NetworkPlanner
    from moe_policy.planners.solver import SolverPlanner
    from moe_policy.rl.actor import LearnedPolicy

    PlannerModel: TypeAlias = NetworkPlanner | NearestPlanner | SolverPlanner | Checked
    PolicyModel: TypeAlias = LearnedPolicy | Stabiliser
    Model: TypeAlias = PlannerModel | PolicyModel

M = TypeVar("M")
PathLike = str | os.PathLike[str]
SHIPPED = Path(__file__).parent / "models"


class UnknownModelError(KeyError):
    """No model of that name is shipped."""

    def __str__(self) -> str:
        return str(self.args[0])


def _read_network(file: ModelFile, problem: OptimalControlProblem) -> NetworkPlanner:
    from moe_policy.planners.network import read_network

    return read_network(file, problem)


def _read_nearest(file: ModelFile, problem: OptimalControlProblem) -> NearestPlanner:
    from moe_policy.planners.nearest import read_nearest

    return read_nearest(file, problem)


def _read_policy(file: ModelFile, problem: OptimalControlProblem) -> LearnedPolicy:
    from moe_policy.rl.actor import read_policy

    return read_policy(file, problem)


def _optimal(problem: OptimalControlProblem) -> SolverPlanner:
    from moe_policy.planners.solver import SolverPlanner

    return SolverPlanner(problem, shipped_nearest(problem))


def _stabiliser(problem: OptimalControlProblem) -> Stabiliser:
    from moe_policy.control.stabiliser import Stabiliser

    return Stabiliser(problem)


def _checked(problem: OptimalControlProblem) -> Checked:
    from moe_policy.planners.network import NetworkPlanner

    settings = checking.SHIPPED[problem.id]
    return settings.checked(load(problem, settings.planner, kind=NetworkPlanner), shipped_nearest(problem))


#: What makes a model of the files of each kind.
READERS: Mapping[str, Callable[[ModelFile, OptimalControlProblem], Model]] = MappingProxyType(
    {"network": _read_network, "nearest": _read_nearest, "rl": _read_policy}
)
#: What makes the models that need no files.
ALWAYS: Mapping[str, Callable[[OptimalControlProblem], Model]] = MappingProxyType(
    {"optimal": _optimal, "stabiliser": _stabiliser}
)
#: What makes the models that are made of other shipped models.
COMPOSED: Mapping[str, Callable[[OptimalControlProblem], Model]] = MappingProxyType({"checked": _checked})


def _expect(model: Model, kind: type[M], name: object) -> M:
    if not isinstance(model, kind):
        raise TypeError(f"{name} is a {type(model).__name__}, expected a {kind.__name__}")
    return model


@checked
def available(problem: ProblemOrId) -> list[str]:
    """Names that :func:`load` knows for ``problem``, or for the registered one of that id, in alphabetical order."""
    problem = problem_of(problem)
    shipped = {path.name.removesuffix(".json") for path in (SHIPPED / problem.id).glob("*.json")}
    if problem.id in checking.SHIPPED and checking.SHIPPED[problem.id].planner in shipped:
        shipped |= set(COMPOSED)
    # Where the goal cannot be held there is no controller that stabilises it.
    return sorted(shipped | (set(ALWAYS) if problem.hold else set(ALWAYS) - {"stabiliser"}))


@overload
def load(problem: ProblemOrId, name: str) -> Model: ...
@overload
def load(problem: ProblemOrId, name: str, *, kind: type[M]) -> M: ...
@checked
def load(problem: ProblemOrId, name: str, *, kind: type[M] | None = None) -> Model | M:
    """A shipped planner or policy.

    Args:
        problem: a problem or the id of a registered one.
        name: one of :func:`available`.
        kind: the class that is expected, such as ``NetworkPlanner``; by default any.

    Raises:
        UnknownProblemError: no such problem.
        UnknownModelError: no such model; the message names the nearest one.
        ModelFileError: its files are unusable, or made for another problem of that id.
        TypeError: the model is of another class than ``kind``.
    """
    problem, names = problem_of(problem), available(problem)
    if name not in names:
        raise UnknownModelError(f"{problem.id} has no model {name!r}; {did_you_mean(name, names)}there are {names}")
    made = {**ALWAYS, **COMPOSED}
    model = made[name](problem) if name in made else load_file(SHIPPED / problem.id / name, problem)
    return model if kind is None else _expect(model, kind, name)


@checked
def load_planner(problem: ProblemOrId, name: str) -> PlannerModel:
    """:func:`load` with the types of planners alone; TypeError where ``name`` is a policy of ``problem``."""
    model = load(problem, name)
    if isinstance(model, Policy):
        raise TypeError(f"{name} is a policy, expected a planner; use load_policy")
    return model


@checked
def load_policy(problem: ProblemOrId, name: str) -> PolicyModel:
    """:func:`load` with the types of policies alone; TypeError where ``name`` is a planner of ``problem``."""
    model = load(problem, name)
    if not isinstance(model, Policy):
        raise TypeError(f"{name} is a planner, expected a policy; use load_planner")
    return model


@overload
def load_file(path: PathLike, problem: ProblemOrId | None = None) -> Model: ...
@overload
def load_file(path: PathLike, problem: ProblemOrId | None = None, *, kind: type[M]) -> M: ...
@checked
def load_file(path: PathLike, problem: ProblemOrId | None = None, *, kind: type[M] | None = None) -> Model | M:
    """The planner or policy saved at ``path``.

    Args:
        path: with or without one of the suffixes ``.safetensors`` and ``.json``.
        problem: what it is to be used for, or the id; by default the registered problem of the id in the file.
        kind: the class that is expected, such as ``NetworkPlanner``; by default any.

    Raises:
        ModelFileError: the files are unusable, or made for another problem.
        UnknownProblemError: the problem is not registered.
        TypeError: the model is of another class than ``kind``.
        ValueError: a path without a name.
    """
    file = read_model(path)
    problem = problem_of(str(file.description.get("problem")) if problem is None else problem)
    file.check_problem(problem)
    try:
        model = READERS[file.description["kind"]](file, problem)
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        raise ModelFileError(f"{file.path}: tensors and description do not fit together ({error})") from error
    return model if kind is None else _expect(model, kind, file.path)


def shipped_nearest(problem: ProblemOrId) -> NearestPlanner | None:
    """The shipped optimal trajectories of ``problem`` as a planner, for warm starts; ``None`` where there are none."""
    from moe_policy.planners.nearest import NearestPlanner

    return load(problem, "nearest", kind=NearestPlanner) if "nearest" in available(problem) else None
