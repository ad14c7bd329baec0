"""Parametric optimal control problems as Gymnasium environments, with known optimal trajectories.

``import ocp_envs`` registers the environments; ``gymnasium.make("ocp_envs:PendulumSwingup-v0")`` does so by itself.
"""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium as gym

from ocp_envs.envs.env import Env
from ocp_envs.envs.simulation import Simulator
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.goal import Goal, Modes, winding_modes
from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import BENCHMARK, UnknownProblemError, add, load, names
from ocp_envs.problems.description import describe
from ocp_envs.render.over_time import plot_trajectory
from ocp_envs.system import Box, Coordinate, System
from ocp_envs.trajectory import Trajectory

__all__ = [
    "Box",
    "Coordinate",
    "Database",
    "Env",
    "Goal",
    "Modes",
    "OptimalControlProblem",
    "OutsideBoxError",
    "Simulator",
    "Solution",
    "System",
    "Trajectory",
    "UnknownProblemError",
    "VectorEnv",
    "describe",
    "generate",
    "grid",
    "load",
    "names",
    "plot_trajectory",
    "register",
    "sample",
    "solve",
    "winding_modes",
]

#: Imported when first asked for: who only steps an environment does not wait for solvers and databases.
_LATER = {
    "Database": "data.database",
    "Solution": "solvers.solver",
    "generate": "data.generation",
    "grid": "sets.sampling",
    "sample": "sets.sampling",
    "solve": "solvers.solver",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'ocp_envs' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"ocp_envs.{_LATER[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def register(problem: OptimalControlProblem) -> None:
    """Make ``problem`` known to :func:`load`, ``gymnasium.make`` and ``gymnasium.make_vec`` under its id.

    Registering the same object again changes nothing.

    Raises:
        ValueError: another problem, or another package's environment, already has that id.
    """
    entry_point = "ocp_envs.envs.env:Env"
    if problem.id in gym.registry and gym.registry[problem.id].entry_point != entry_point:
        raise ValueError(f"Gymnasium already has an environment {problem.id!r}; give your problem another id")
    add(problem)
    if problem.id not in gym.registry:
        gym.register(
            id=problem.id,
            entry_point=entry_point,
            vector_entry_point="ocp_envs.envs.vector_env:VectorEnv",
            max_episode_steps=None,  # the time limit is the environment's own, in seconds
            kwargs={"problem": problem.id},
        )


for _problem in BENCHMARK:
    register(_problem)
