"""Parametric optimal control problems as Gymnasium environments, with known optimal trajectories.

``import ocp_envs`` registers the environments; ``gymnasium.make("ocp_envs:PendulumSwingup-v0")`` does so by itself.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import gymnasium as gym

from ocp_envs.distribution import Blocked, Distribution, Uniform
from ocp_envs.envs.env import Env
from ocp_envs.envs.simulation import ControlStep, Simulator, Step
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.goal import Goal, Modes, winding_modes
from ocp_envs.parameters import OutsideBoxError, Parametrisation
from ocp_envs.picture import Ball, Face, Line, Picture, Shape, disc
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import BENCHMARK, UnknownProblemError, add, load, names
from ocp_envs.problems.description import describe
from ocp_envs.render.over_time import plot_trajectory
from ocp_envs.support.batch import BatchFunction, BoundFunction
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, Coordinate, System
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from ocp_envs.data.database import Database
    from ocp_envs.data.generation import generate
    from ocp_envs.data.layout import StoredRows
    from ocp_envs.data.samples import Samples, SampleSource
    from ocp_envs.data.settings import GenerationSettings
    from ocp_envs.sets.reference import ReferenceSet
    from ocp_envs.sets.reference import load as load_reference
    from ocp_envs.sets.sampling import grid, sample
    from ocp_envs.solvers.nlp import SolverSettings, Status
    from ocp_envs.solvers.solutions import Solutions
    from ocp_envs.solvers.solver import Solution, solve

__all__ = [
    "Ball",
    "BatchFunction",
    "Blocked",
    "BoundFunction",
    "Box",
    "ControlStep",
    "Coordinate",
    "Database",
    "Distribution",
    "Env",
    "Face",
    "GenerationSettings",
    "Goal",
    "Line",
    "Modes",
    "OptimalControlProblem",
    "OutsideBoxError",
    "Parametrisation",
    "Picture",
    "ReferenceSet",
    "SampleSource",
    "Samples",
    "Shape",
    "Simulator",
    "Solution",
    "Solutions",
    "SolverSettings",
    "Status",
    "Step",
    "StoredRows",
    "Symmetry",
    "System",
    "Trajectory",
    "Uniform",
    "UnknownProblemError",
    "VectorEnv",
    "describe",
    "disc",
    "generate",
    "grid",
    "load",
    "load_reference",
    "names",
    "plot_trajectory",
    "register",
    "sample",
    "solve",
    "winding_modes",
]

#: Module and name there of what is imported when first asked for: stepping an environment needs no solver or database.
_LATER = {
    "Database": ("data.database", "Database"),
    "GenerationSettings": ("data.settings", "GenerationSettings"),
    "ReferenceSet": ("sets.reference", "ReferenceSet"),
    "SampleSource": ("data.samples", "SampleSource"),
    "Samples": ("data.samples", "Samples"),
    "Solution": ("solvers.solver", "Solution"),
    "Solutions": ("solvers.solutions", "Solutions"),
    "SolverSettings": ("solvers.nlp", "SolverSettings"),
    "Status": ("solvers.nlp", "Status"),
    "StoredRows": ("data.layout", "StoredRows"),
    "generate": ("data.generation", "generate"),
    "grid": ("sets.sampling", "grid"),
    "load_reference": ("sets.reference", "load"),
    "sample": ("sets.sampling", "sample"),
    "solve": ("solvers.solver", "solve"),
}


def __getattr__(name: str) -> object:
    if name not in _LATER:
        raise AttributeError(f"module 'ocp_envs' has no attribute {name!r}")
    module, there = _LATER[name]
    value = getattr(importlib.import_module(f"ocp_envs.{module}"), there)
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
