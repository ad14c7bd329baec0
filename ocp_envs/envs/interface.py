"""What a policy must know of an environment: its coordinates with their units, its control period and its spaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import gymnasium as gym
import numpy as np

from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.doors import checked
from ocp_envs.system import Box


@checked
@dataclass(frozen=True)
class Interface:
    """The interface of an environment; unlike the environment, it travels between processes.

    Args:
        problem: id of the problem.
        dt: length of a control step, seconds.
        state, context, control: the boxes of the problem.
    """

    problem: str
    dt: float
    state: Box
    context: Box
    control: Box

    @classmethod
    @checked
    def of(cls, problem: ProblemOrId, dt: float) -> Interface:
        """The interface of environments of ``problem`` with control steps of ``dt`` seconds."""
        problem = problem_of(problem)
        return cls(problem.id, dt, problem.system.state, problem.context, problem.system.control)

    @cached_property
    def observation_space(self) -> gym.spaces.Box:
        """State box and context box; float32 rounds by up to half a step, so the bounds lie one step further out."""
        boxes = (self.state, self.context)
        lower = np.concatenate([box.lower for box in boxes]).astype(np.float32)
        upper = np.concatenate([box.upper for box in boxes]).astype(np.float32)
        infinity = np.float32(np.inf)
        return gym.spaces.Box(np.nextafter(lower, -infinity), np.nextafter(upper, infinity), dtype=np.float32)

    @cached_property
    def action_space(self) -> gym.spaces.Box:
        """The control box."""
        lower, upper = self.control.lower, self.control.upper
        return gym.spaces.Box(lower.astype(np.float32), upper.astype(np.float32), dtype=np.float32)

    @property
    def coordinates(self) -> str:
        """The coordinates of observations and actions with their units, in words."""
        observed = (*self.state.coordinates, *self.context.coordinates)
        named = [", ".join(f"{c.name} [{c.unit}]" for c in group) for group in (observed, self.control.coordinates)]
        return f"observations ({named[0]}) and actions ({named[1]})"
