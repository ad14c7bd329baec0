"""Vector environments as rollouts need them."""

from __future__ import annotations

from typing import Unpack

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ocp_envs.envs.options import EnvArguments
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked

#: A vector environment of :mod:`ocp_envs`, wrapped or not: float32 observations, float64 actions and rewards.
Environments = gym.vector.VectorEnv[NDArray[np.float32], Array, Array]


@checked
def environments(problem: ProblemOrId, count: int, dt: float = 0.02, **arguments: Unpack[EnvArguments]) -> VectorEnv:
    """``count`` environments that neither restart by themselves nor end at the goal, as ``rollout`` needs them.

    Their control period is ``dt`` seconds; ``problem`` may be registered or not; ``arguments`` are further ones of
    :class:`ocp_envs.Env`.
    """
    problem = problem_of(problem)
    chosen: EnvArguments = {"terminate_at_goal": False, **arguments}
    return VectorEnv(problem, count, autoreset_mode=AutoresetMode.DISABLED, dt=dt, **chosen)


def base_of(envs: Environments) -> VectorEnv:
    """The vector environment of :mod:`ocp_envs` inside the wrappers of ``envs``; a ``TypeError`` for any other."""
    base = envs.unwrapped
    if not isinstance(base, VectorEnv):
        raise TypeError(f"expected a vector environment of ocp_envs, wrapped or not; got {type(base).__name__}")
    return base
