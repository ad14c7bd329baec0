"""A call that fits for each method that users call with data of their own: arrays, paths, problems, environments."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np

from ocp_envs.problems.pendulum import PENDULUM
from tests.door_calls import BY_NAME, Door, doors
from tests.door_values import VALUES, P, database
from tests.small_problems import DOUBLE_INTEGRATOR

#: What the data of a user are annotated with.
_DATA = re.compile(r"\b(ArrayLike|PathLike|ProblemOrId|Environment|Info)\b")
#: Arguments that fit, by name, where those of other callables do not.
_OWN: dict[str, Callable[[], Any]] = {
    "action": lambda: np.zeros(1),
    "actions": lambda: np.zeros((1, 1)),
    "change": lambda: np.zeros(2),
    "contexts": lambda: np.zeros((2, 0)),
    "controls": lambda: np.zeros((2, 1)),
    "env": lambda: gym.make(PENDULUM.id),
    "mode": lambda: np.zeros(2, np.int64),
    "observation": lambda: P,
    "p": lambda: P,
    "states": lambda: P,
    "trajectory": lambda: VALUES["Trajectory"](),
    "values": lambda: P,
    "z": lambda: VALUES["Trajectory"]().flat(),
}
#: Arguments that fit single methods.
_CALLS: dict[str, dict[str, Callable[[], Any]]] = {
    "Database.create": {"problem": lambda: DOUBLE_INTEGRATOR},
    "Database.open": {"path": lambda: database().path, "problem": lambda: DOUBLE_INTEGRATOR},
    "OptimalControlProblem.unflatten": {"z": lambda: np.zeros((2, DOUBLE_INTEGRATOR.flat_size))},
    "Trajectory.from_flat": {"knots": lambda: 25, "nx": lambda: 2, "nu": lambda: 1},
}


#: Methods that need more than a call: a complete database, and a package that may be absent.
_ELSEWHERE = {"Database.grow", "Episodes.to_frame"}


@cache
def _instance(door: Door) -> Any:
    return VALUES[door.short]() if door.short in VALUES else door.value(**door.arguments())


@dataclasses.dataclass(frozen=True)
class Method(Door):
    """The method ``function`` of the class behind the door ``owner``."""

    owner: Door
    function: Callable[..., Any]

    @property
    def short(self) -> str:
        return ".".join(self.name.split(".")[-2:])

    @property
    def signature(self) -> inspect.Signature:
        parameters = list(inspect.signature(self.function).parameters.values())
        return inspect.Signature(parameters[1:])

    def arguments(self) -> dict[str, Any]:
        own = _CALLS.get(self.short, {})
        wanted = {name for name, each in self.signature.parameters.items() if each.default is each.empty} | own.keys()
        if self.short in ("WithMargin.__call__", "Symmetrised.__call__"):
            problem = _instance(self.owner).problem
            return {"p": problem.parameters.centre[None]}
        fitting = {**BY_NAME, **_OWN, **own}
        return {name: (fitting.get(name) or self._by_kind(name))() for name in wanted}


def _method(owner: Door, name: str, function: Callable[..., Any]) -> Method:
    def call(**arguments: Any) -> Any:
        instance = _instance(owner)
        if isinstance(instance, gym.Env | gym.vector.VectorEnv):
            instance.reset(seed=0)
        return getattr(instance, name)(**arguments)

    return Method(f"{owner.name}.{name}", call, owner, function)


def methods() -> Iterator[Method]:
    """The methods of exported classes that take data of a user."""
    for door in doors():
        known: set[str] = set()
        for base in door.value.__mro__ if inspect.isclass(door.value) else ():
            for name, member in vars(base).items() if base.__module__.startswith(("ocp_envs", "moe_policy")) else ():
                function = getattr(member, "__func__", member)
                if name in known or not inspect.isfunction(function) or (name[0] == "_" and name != "__call__"):
                    continue
                known.add(name)
                kinds = [str(each.annotation) for each in inspect.signature(function).parameters.values()]
                if any(map(_DATA.search, kinds)) and f"{door.short}.{name}" not in _ELSEWHERE:
                    yield _method(door, name, function)
