"""Terminal regulation: policies that regulate the state at the goal, without a plan or after another policy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from moe_policy.control.fit import Environment
from moe_policy.control.lqr import Regulator
from moe_policy.control.observations import split
from moe_policy.control.policy import ModelPolicy, act
from moe_policy.control.projection import project
from moe_policy.control.weights import TrackingWeights
from moe_policy.protocols import ExactPolicy, Policy, State
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked


class Stabiliser(ModelPolicy):
    """The LQR regulator at the goal, from the initial state on. A NaN in an observation gives a NaN.

    Args:
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.
    """

    @checked
    def __init__(self, problem: ProblemOrId, dt: float = 0.02, weights: TrackingWeights | None = None) -> None:
        problem = problem_of(problem)
        self.problem, self.regulator = problem, Regulator(problem, dt, weights)
        self.dt = self.regulator.dt

    def controls(self, states: Array, contexts: Array) -> Array:
        """Controls (B, nu) at ``states`` (B, nx) in ``contexts`` (B, nc)."""
        problem, regulator, terminal = self.problem, self.regulator, self.problem.terminal
        error = problem.system.difference(states, terminal.states(contexts))
        held = regulator.at_goal(contexts)
        wanted = terminal.controls(contexts) - (held.gain @ error[..., None])[..., 0]
        return project(wanted, held.norm, problem.system.control)

    def act(self, observations: NDArray[np.floating], state: State, begins: Bools) -> tuple[Array, State]:
        return self.controls(*split(self.problem, observations)), None

    def __repr__(self) -> str:
        return f"Stabiliser({self.problem.id!r}, dt={self.dt})"


@checked
@dataclass(frozen=True, eq=False)
class Entered:
    """Recurrent state of :class:`Stabilised`: that of the ``inner`` policy, and the rows (B,) that have ``entered``."""

    inner: State
    entered: Bools


class Stabilised(ModelPolicy):
    """A policy that hands over to the stabiliser when the state first enters the goal ball.

    Args:
        policy: any policy that reads observations of this environment.
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: see :class:`Stabiliser`.
    """

    recurrent = Entered

    @checked
    def __init__(
        self,
        policy: Policy,
        problem: ProblemOrId,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> None:
        problem = problem_of(problem)
        self.policy, self.problem = policy, problem
        self.stabiliser = Stabiliser(problem, dt, weights)
        self.dt = self.stabiliser.dt

    def check(self, env: Environment) -> None:
        super().check(env)
        if isinstance(self.policy, ExactPolicy):
            self.policy.check(env)

    def act(self, observations: NDArray[np.floating], state: Entered | None, begins: Bools) -> tuple[Array, Entered]:
        x, contexts = split(self.problem, observations)
        before = np.zeros(len(x), bool) if state is None else state.entered & ~begins
        entered = before | (self.problem.goal_error(x, contexts) < self.problem.goal.radius)
        inner = None if state is None else state.inner
        controls, inner = act(self.policy, observations, inner, begins)
        return np.where(entered[:, None], self.stabiliser.controls(x, contexts), controls), Entered(inner, entered)

    def __repr__(self) -> str:
        return f"Stabilised({self.policy!r}, {self.problem.id!r}, dt={self.dt})"
