"""Parametric optimal control problems as Gymnasium environments, with known optimal trajectories.

``import ocp_envs`` registers the environments; ``gymnasium.make("ocp_envs:PendulumSwingup-v0")`` does so by itself.
"""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium as gym

from ocp_envs.env import Env, VectorEnv
from ocp_envs.problem import Goal, Modes, OptimalControlProblem, OutsideBoxError, winding_modes
from ocp_envs.problems import BENCHMARK, UnknownProblemError, add, load, names
from ocp_envs.system import Box, Coordinate, System
from ocp_envs.trajectory import Trajectory


def register(problem: OptimalControlProblem) -> None:
    """Make ``problem`` known to :func:`load`, ``gymnasium.make`` and ``gymnasium.make_vec`` under its id.

    Registering the same object again changes nothing.

    Raises:
        ValueError: another problem already has that id.
    """
    add(problem)
    if problem.id not in gym.registry:
        gym.register(
            id=problem.id,
            entry_point="ocp_envs.env:Env",
            vector_entry_point="ocp_envs.env:VectorEnv",
            max_episode_steps=None,  # the time limit is the environment's own, in seconds
            kwargs={"problem": problem.id},
        )


for _problem in BENCHMARK:
    register(_problem)
