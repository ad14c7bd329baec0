"""A call that fits for every exported callable of both packages: its doors.

Arguments without a default are made from their names, their annotations and the lists below, so that a new callable
needs nothing, or a line.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import moe_policy
import ocp_envs
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers.nlp import Status
from tests.data.running import InProcess
from tests.door_values import (
    QUICK,
    SAMPLES,
    VALUES,
    P,
    actor,
    constant_plans,
    database,
    episodes,
    finished,
    minari_id,
    new_path,
    planner,
    policy,
    sac,
    unsolved,
)
from tests.small_problems import DOUBLE_INTEGRATOR


@cache
def quadcopter_planner() -> Any:
    return moe_policy.load(QUADCOPTER_OBSTACLE, "nearest")


@cache
def saved() -> Path:
    path = new_path()
    planner().save(path)
    return path


@cache
def kept() -> Path:
    return new_path()


def policy_of(problem: Any) -> Any:
    return policy()


#: Arguments that fit every callable which has them, by name.
BY_NAME: dict[str, Callable[[], Any]] = {
    "actor": actor,
    "baseline": episodes,
    "database": lambda: SAMPLES,
    "dt": lambda: 0.02,
    "envs": lambda: moe_policy.environments(PENDULUM, 2),
    "episodes": episodes,
    "function": lambda: PENDULUM.functions.flow(1).function,
    "labels": lambda: moe_policy.cluster(SAMPLES, "custom"),
    "name": lambda: "name",
    "parameters": lambda: P,
    "path": new_path,
    "planner": planner,
    "policy": policy,
    "problem": lambda: PENDULUM,
    "settings": lambda: QUICK,
    "sizes": lambda: [2, 4, 3],
    "trajectories": lambda: SAMPLES.trajectory[:2],
    "trajectory": lambda: SAMPLES.trajectory[:2],
}
#: Arguments of other names, by annotation.
BY_KIND: dict[str, Any] = {"float": 0.5, "int": 2, "bool": False, "str": "name"}
#: Arguments of single callables.
CALLS: dict[str, dict[str, Callable[[], Any]]] = {
    "BestOf": {"candidates": lambda: moe_policy.Candidates(planner())},
    "BoundFunction": {"size": lambda: 2},
    "ControlStep": {"function": lambda: ocp_envs.Simulator(PENDULUM, 0.02)._plain.bind(2)},
    "Database": {"path": lambda: database().path, "problem": lambda: DOUBLE_INTEGRATOR},
    "LearnedPolicy": {"period": lambda: 0.1},
    "Names": {"kind": lambda: "constant", "values": lambda: {"mass": 1.0}},
    "StoredPlans": {"problem": lambda: PENDULUM},
    "Symmetrised": {"problem": lambda: QUADCOPTER_OBSTACLE, "planner": lambda: quadcopter_planner()},
    "WithMargin": {
        "problem": lambda: QUADCOPTER_OBSTACLE,
        "planner": lambda: quadcopter_planner(),
        "parameter": lambda: "radius",
        "margin": lambda: 0.1,
    },
    "beyond": {"families": lambda: SAMPLES.mode, "solve": lambda: unsolved},
    "check": {"instances": lambda: 1},
    "cluster": {"method": lambda: "custom"},
    "compare": {"clusters": lambda: [2], "test": lambda: 2, "development": lambda: 2, "repaired": lambda: False},
    "disc": {"center": lambda: np.zeros(3), "radius": lambda: 1.0},
    "environments": {"count": lambda: 2},
    "RLSettings": {"steps": lambda: 8},
    "export_minari": {"dataset_id": lambda: f"ocp/{new_path().name}door-v0", "parameters": lambda: [[3.0, 0.0]]},
    "fit_mixture_jointly": {"k": lambda: 2},
    "generate": {
        "problem": lambda: DOUBLE_INTEGRATOR,
        "parameters": lambda: np.array([[1.0, 0.0]]),
        "executor": InProcess,
        "settings": lambda: ocp_envs.GenerationSettings(first=1, chunk=1, starts=1, neighbours=1, lookaround=1),
    },
    "grid": {"shape": lambda: (2, 2)},
    "load": {"name": lambda: "nearest"},
    "load_file": {"path": lambda: saved()},
    "load_planner": {"name": lambda: "nearest"},
    "load_policy": {"name": lambda: "stabiliser"},
    "load_reference": {"split": lambda: "validation"},
    "names": {},
    "ocp_envs.load": {"name": lambda: "PendulumSwingup-v0"},
    "refine": {"database": finished, "planner": lambda: lambda p: constant_plans(p)},
    "read_minari": {"dataset": minari_id},
    "resimulate": {"dataset": minari_id},
    "rollout": {"horizon": lambda: 0.1},
    "sample": {"seed": lambda: 1, "n": lambda: 2},
    "score_method": {
        "factory": lambda: policy_of,
        "splits": lambda: ["uniform"],
        "cases": lambda: 1,
        "keep": lambda: kept(),
        "workers": lambda: 1,
    },
    "solve": {"p": lambda: [3.1, 0.1], "starts": lambda: 1},
    "solve_many": {"p": lambda: [[3.1, 0.1]], "starts": lambda: 1},
    "train": {"settings": sac, "development": lambda: P},
    "winding_modes": {"names": lambda: ("left", "middle", "right")},
}


@dataclasses.dataclass(frozen=True)
class Door:
    """An exported callable ``value`` with its ``name``, ``package.name``."""

    name: str
    value: Callable[..., Any]

    @property
    def short(self) -> str:
        return self.name.rpartition(".")[2]

    @property
    def signature(self) -> inspect.Signature:
        return inspect.signature(self.value)

    def arguments(self) -> dict[str, Any]:
        """Arguments that fit."""
        if self.short in VALUES:
            value = VALUES[self.short]()
            return {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.init}
        own = CALLS.get(self.name, CALLS.get(self.short, {}))
        named = {name for name, each in self.signature.parameters.items() if each.default is each.empty}
        named |= own.keys() | ({"settings"} & self.signature.parameters.keys())
        kinds = {name: self.signature.parameters[name].kind for name in named if name in self.signature.parameters}
        wanted = [name for name, kind in kinds.items() if kind not in (2, 4)]
        return {name: (own.get(name) or BY_NAME.get(name) or self._by_kind(name))() for name in wanted}

    def _by_kind(self, name: str) -> Callable[[], Any]:
        kind = str(self.signature.parameters[name].annotation).partition(" |")[0]
        if kind not in VALUES and kind not in BY_KIND:
            raise KeyError(f"{self.name}({name}: {kind}): give it a value that fits in tests/door_calls.py")
        return VALUES.get(kind) or (lambda: BY_KIND[kind])


def doors() -> Iterator[Door]:
    """Every exported callable that makes something: no protocols, abstract classes, enumerations and exceptions."""
    for package in (ocp_envs, moe_policy):
        for name in package.__all__:
            value = getattr(package, name)
            cls = value if inspect.isclass(value) else None
            bare = cls is not None and (
                issubclass(cls, (dict, Status, Exception))
                or getattr(cls, "_is_protocol", False)
                or inspect.isabstract(cls)
                or name == "Estimate"
            )
            if callable(value) and not bare:
                yield Door(f"{package.__name__}.{name}", value)
