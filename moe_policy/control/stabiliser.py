"""Terminal regulation: policies that regulate the state at the goal, without a plan or after another policy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.lqr import Regulator
from moe_policy.control.observations import beginning, shaped_as, split
from moe_policy.control.projection import project
from moe_policy.control.weights import TrackingWeights
from moe_policy.protocols import Policy, State
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools


class Stabiliser:
    """The LQR regulator at the goal, from the initial state on.

    Args:
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.
    """

    def __init__(
        self, problem: OptimalControlProblem, dt: float = 0.02, weights: TrackingWeights | None = None
    ) -> None:
        self.problem, self.regulator = problem, Regulator(problem, dt, weights)
        self.dt = self.regulator.dt

    def controls(self, states: Array) -> Array:
        """Controls (B, nu) at ``states`` (B, nx)."""
        problem, regulator = self.problem, self.regulator
        wanted = problem.goal.control - problem.system.difference(states, problem.goal.state) @ regulator.hold.T
        norm = np.broadcast_to(regulator.hold_norm, (len(states), *regulator.hold_norm.shape))
        return project(wanted, norm, problem.system.control)

    def predict(
        self,
        observation: ArrayLike,
        state: object = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, None]:
        return shaped_as(observation, self.controls(split(self.problem, observation)[0])), None


@dataclass(frozen=True, eq=False)
class Entered:
    """Recurrent state of :class:`Stabilised`: that of the ``inner`` policy, and the rows (B,) that have ``entered``."""

    inner: State
    entered: Bools


class Stabilised:
    """A policy that hands over to the stabiliser when the state first enters the goal ball.

    Args:
        policy: any policy that reads observations of this environment.
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: see :class:`Stabiliser`.
    """

    def __init__(
        self,
        policy: Policy,
        problem: OptimalControlProblem,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> None:
        self.policy, self.problem = policy, problem
        self.stabiliser = Stabiliser(problem, dt, weights)
        self.dt = self.stabiliser.dt

    def predict(
        self,
        observation: ArrayLike,
        state: Entered | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Entered]:
        x, _ = split(self.problem, observation)
        before = np.zeros(len(x), bool) if state is None else state.entered & ~beginning(episode_start, len(x))
        entered = before | (self.problem.goal_error(x) < self.problem.goal.radius)
        inner_state = None if state is None else state.inner
        controls, inner = self.policy.predict(observation, inner_state, episode_start, deterministic)
        held = np.where(entered[:, None], self.stabiliser.controls(x), np.atleast_2d(controls))
        return shaped_as(observation, held), Entered(inner, entered)
