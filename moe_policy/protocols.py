"""The interfaces of planners and policies, and the schedule that a planning policy announces for its episodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: The recurrent state of a policy, of a type of its own.
State: TypeAlias = Any


@runtime_checkable
class Planner(Protocol):
    """A planner maps parameters to plans."""

    def __call__(self, parameters: Array, /) -> Trajectory:
        """The plans of parameters (B, np), B of them; NaN where planning failed."""


@runtime_checkable
class Policy(Protocol):
    """A policy maps observations to controls, with the signature of Stable-Baselines3.

    ``isinstance(model, Policy)`` tells policies from planners. A policy made for one control period has it as its
    attribute ``dt``, in seconds.
    """

    def predict(
        self,
        observation: ArrayLike,
        state: State = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.floating], State]:
        """The controls of one control step, and the recurrent state for the next call.

        Args:
            observation: one observation, or a batch of B.
            state: the recurrent state that the last call returned; ``None`` at first.
            episode_start: whether each episode of the batch starts now, (B,).
            deterministic: whether the policy's mean control is taken rather than a random one.
        """


@runtime_checkable
class ExactPolicy(Policy, Protocol):
    """A policy that knows its controls in full precision, and whether it fits an environment; rollouts use both."""

    def act(self, observations: NDArray[np.floating], state: State, begins: Bools) -> tuple[Array, State]:
        """The controls (B, nu) at ``observations`` (B, nx + nc) in float64, and the next recurrent ``state``.

        ``begins`` (B,) marks the episodes that begin now; without a state all do.
        """

    def check(self, env: Any) -> None:
        """Refuse an environment ``env`` for which the policy is not made, with a TypeError or a ValueError."""


@checked
@dataclass(frozen=True, eq=False)
class Schedule(Batch):
    """The schedule of a batch of B planned episodes, known before they run; all arrays are (B,).

    Args:
        plan_end: time of the control step at which the plan ends, seconds; 0 for a rejected plan.
        evaluation: evaluation time, at which success is decided, seconds.
        knot_step: time between the knots of the plan, seconds; NaN for a rejected plan, and where the plan is renewed.
        clipped: whether the plan's duration was outside its bounds and was clipped.
        rejected: whether the plan was not finite, so that the policy regulates to the goal from the beginning.
    """

    plan_end: Array
    evaluation: Array
    knot_step: Array
    clipped: Bools
    rejected: Bools

    def shifted(self, seconds: Array) -> Schedule:
        """This schedule with times that are later by ``seconds`` (B,); when its knots were is no longer known."""
        unknown = np.full(len(seconds), np.nan)
        return replace(self, plan_end=self.plan_end + seconds, evaluation=self.evaluation + seconds, knot_step=unknown)


@runtime_checkable
class PlanningPolicy(Policy, Protocol):
    """A policy that plans at the beginning of an episode: it takes the parameters in full precision, and it knows its
    evaluation time. One that plans again on the way announces another schedule then.
    """

    def start(self, parameters: Array) -> State:
        """The recurrent state at the beginning of episodes with ``parameters`` (B, np)."""

    def schedule(self, state: State) -> Schedule | None:
        """The schedule of episodes with the recurrent ``state`` of :meth:`start`, or with a later one.

        Where nothing has changed it is the same object; ``None`` for a wrapper of a policy without plans.
        """
