"""The seams: what makes plans, what acts, and what a policy tells about its own schedule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.arrays import Array
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory


class Planner(Protocol):
    """Whatever makes plans: parameters (B, np) → Trajectory of B plans; a plan that failed holds NaN."""

    def __call__(self, parameters: Array, /) -> Trajectory: ...


class Policy(Protocol):
    """Whatever acts, with the signature of Stable-Baselines3.

    A policy made for one control period says so in an attribute ``dt``, in seconds.
    """

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Actions of a batch (or of one) of observations, and the recurrent state to hand back next time."""
        ...


@dataclass(frozen=True, eq=False)
class Schedule(Batch):
    """What a planning policy tells about a batch of episodes before they run; all arrays are (B,).

    Args:
        plan_end: seconds from the start to the tick at which the plan ends; 0 for a rejected plan.
        judging: seconds from the start to the time at which success is judged.
        knot_step: seconds between the knots of the plan, NaN for a rejected plan.
        clipped: whether the plan's duration was outside its bounds and was clipped.
        rejected: whether the plan was not finite, so that the goal is held from the start.
    """

    plan_end: Array
    judging: Array
    knot_step: Array
    clipped: NDArray[np.bool_]
    rejected: NDArray[np.bool_]


@runtime_checkable
class PlanningPolicy(Policy, Protocol):
    """A policy that knows from the start when it wants to be judged, and that takes the parameter in full precision."""

    def start(self, parameters: Array) -> Any:
        """The recurrent state at the start of episodes with ``parameters`` (B, np)."""
        ...

    def schedule(self, state: Any) -> Schedule:
        """The schedule of the episodes that began with the recurrent state ``state``."""
        ...
