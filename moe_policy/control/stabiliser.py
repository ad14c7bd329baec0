"""Terminal regulation: policies that hold the goal, without a plan or after another policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.lqr import Regulator
from moe_policy.control.observations import beginning, shaped_as, split
from moe_policy.control.projection import project
from moe_policy.control.weights import TrackingWeights
from moe_policy.protocols import Policy
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
        self.problem = problem
        self.regulator = Regulator(problem, dt, weights)
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
        """Controls of one control step, as in Stable-Baselines3.

        Args:
            observation: states and contexts, (B, nx + nc) or (nx + nc,).
            state: accepted for the protocol; there is no recurrent state.
            episode_start: accepted for the protocol.
            deterministic: accepted for the protocol.

        Returns:
            Controls (B, nu) or (nu,), and ``None``.
        """
        return shaped_as(observation, self.controls(split(self.problem, observation)[0])), None


@dataclass(frozen=True, eq=False)
class Entered:
    """Recurrent state of :class:`Stabilised`.

    Args:
        inner: the recurrent state of the inner policy.
        entered: rows that have entered the goal ball, (B,).
    """

    inner: Any
    entered: Bools


class Stabilised:
    """A policy that hands over to the stabiliser when the state first enters the goal ball.

    Args:
        policy: any policy that reads observations of this environment.
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: of the stabiliser; :meth:`TrackingWeights.default` where not given.
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
        """Controls of one control step, as in Stable-Baselines3.

        Args:
            observation: states and contexts, (B, nx + nc) or (nx + nc,).
            state: what the last call returned; ``None`` at the beginning.
            episode_start: rows in which an episode begins, (B,) or ``None``.
            deterministic: passed on to the inner policy.

        Returns:
            Controls (B, nu) or (nu,), and the recurrent state.
        """
        x, _ = split(self.problem, observation)
        before = np.zeros(len(x), bool) if state is None else state.entered & ~beginning(episode_start, len(x))
        entered = before | (self.problem.goal_error(x) < self.problem.goal.radius)
        inner_state = None if state is None else state.inner
        controls, inner = self.policy.predict(observation, inner_state, episode_start, deterministic)
        held = np.where(entered[:, None], self.stabiliser.controls(x), np.atleast_2d(controls))
        return shaped_as(observation, held), Entered(inner, entered)
