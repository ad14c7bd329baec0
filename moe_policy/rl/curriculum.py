"""Curricula of reinforcement learners: which episodes come first, and where they end.

Policies are run without them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from gymnasium.vector import VectorWrapper

from moe_policy.rl.features import Float32
from moe_policy.rl.wrappers import Info
from moe_policy.rollouts.environments import Environments, base_of
from ocp_envs.distribution import UNIFORM
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box

#: The factor by which a goal ball shrinks, and the fraction of the episodes that have to end in it.
SHRINKING, ARRIVED = 0.9, 0.8


class VectorShrinkingGoal(VectorWrapper[Float32, Array, Float32, Array, Array]):
    """Episodes end in a larger goal ball at first, which shrinks to that of the problem as the learner gets better.

    Exploration enters a small ball in many coordinates only when its noise is small, and without entering it a learner
    does not learn that this ends all costs. The radius is multiplied by :data:`SHRINKING` where :data:`ARRIVED` of as
    many episodes as there are rows, or more, have ended in the ball since the last time.

    Args:
        env: a vector environment made with ``terminate_at_goal=True`` and ``autoreset_mode="Disabled"``.
        first: the radius at first, larger than that of the problem.
    """

    def __init__(self, env: Environments, first: float) -> None:
        super().__init__(env)
        self._base, self.radius = base_of(env), first
        self._ended, self._arrived = 0, 0

    def step(self, actions: Array) -> tuple[Float32, Array, Array, Array, Info]:
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        base = self._base
        inside = (base.problem.goal_error(base.state, base.context) < self.radius) & ~base.left_box
        terminated = np.logical_or(terminated, inside)
        self._count(int(np.logical_or(terminated, truncated).sum()), int(inside.sum()))
        return observations, rewards, terminated, truncated, info

    def _count(self, ended: int, arrived: int) -> None:
        """Shrink the ball where enough of the episodes that ``ended`` have ``arrived``."""
        self._ended, self._arrived = self._ended + ended, self._arrived + arrived
        if self._ended < self.num_envs:
            return
        if self._arrived >= ARRIVED * self._ended:
            self.radius = max(SHRINKING * self.radius, self._base.problem.goal.radius)
        self._ended, self._arrived = 0, 0


def with_moving_starts(problem: OptimalControlProblem) -> OptimalControlProblem:
    """``problem`` with a parameter for every state coordinate, so that episodes can begin in any state."""
    own = problem.parameters.coordinates
    added = tuple(c for c in problem.system.state.coordinates if c.name not in problem.parameters.names)
    return replace(problem, parameters=Box((*own, *added)), distribution=UNIFORM) if added else problem


class VectorNearStarts(VectorWrapper[Float32, Array, Float32, Array, Array]):
    """Some episodes start nearer to the goal: at g + f (x_0 − g) instead of x_0, with f = U^n, U uniform in [0, 1].

    A curriculum without a schedule: short episodes teach what the long ones end with (compare Florensa et al., *Reverse
    curriculum generation for reinforcement learning*, 2017). Where ``moving`` is positive these episodes begin in
    motion: coordinates that the parameters of ``problem`` do not name deviate from g + f (x_0 − g) by normal numbers
    of the standard deviation f · ``moving`` · scale. The context stays as it is, and where the nearer initial state
    would violate the path constraints the episode starts at x_0. Only resets without ``parameters`` are changed.

    Args:
        env: a vector environment of ``problem``; of :func:`with_moving_starts` where ``moving`` is positive.
        fraction: the probability of such an initial state.
        seed: that of the draws.
        moving: the standard deviation in units of the scales, 0 for episodes that begin as those of the problem do.
        problem: whose parameters are drawn; by default that of ``env``.
        nearness: n, the power of f; above 1 there are more episodes close to the goal.
    """

    def __init__(
        self,
        env: Environments,
        fraction: float,
        seed: int,
        moving: float = 0.0,
        problem: OptimalControlProblem | None = None,
        nearness: float = 1.0,
    ) -> None:
        super().__init__(env)
        self._nearness = nearness
        self._base, self._fraction, self._rng = base_of(env), fraction, np.random.default_rng(seed)
        self._problem = self._base.problem if problem is None else problem
        names = self._problem.parameters.names
        still = np.array([name not in names for name in self._problem.system.state.names])
        self._deviation = np.where(still, moving * self._problem.system.state.scale, 0.0)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Float32, Info]:
        options = dict(options or {})
        if "parameters" not in options:
            options["parameters"] = self._draw()
        return self.env.reset(seed=seed, options=options)

    def _draw(self) -> Array:
        """Parameters of the environment for one episode of each row, (num_envs, np)."""
        problem, base, count = self._problem, self._base.problem, self.num_envs
        p = problem.distribution.draw(problem, [self._rng] * count)
        states, contexts = problem.start(p)
        p, box = base.parameters_of(states, contexts), base.parameters
        goal = np.clip(base.parameters_of(problem.terminal.states(contexts), contexts), box.lower, box.upper)
        factor = np.where(self._rng.random(count) < self._fraction, self._rng.random(count) ** self._nearness, 1.0)[
            :, None
        ]
        nearer = goal + factor * (p - goal)
        if self._deviation.any():
            deviations = np.where(factor < 1, factor, 0.0) * self._deviation * self._rng.standard_normal(states.shape)
            nearer += base.parameters_of(deviations, np.zeros_like(contexts))
            nearer = np.clip(nearer, box.lower, box.upper)
        if problem.n_clearances:
            (clearances,) = problem.functions.clearances()(*base.start(nearer))
            nearer = np.where(clearances.min(axis=1, keepdims=True) >= 0, nearer, p)
        return nearer
