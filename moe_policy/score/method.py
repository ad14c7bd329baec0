"""A planner or a policy under a name, and how it flies: by the same rules for all.

A planner is tracked with LQR, and the goal is regulated after its plan. A learned policy acts until it first enters the
goal ball; from then on the goal is regulated, too, where the problem allows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.weights import TrackingWeights
from moe_policy.protocols import Planner, PlanningPolicy, Policy
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

#: Episodes that run at once: the gains, references and metrics of 10,000 plans would need gigabytes.
BATCH = 500


@dataclass(frozen=True, eq=False)
class Method:
    """A planner or a policy under a name.

    Args:
        name: in tables; one of the shipped names, such as ``"moe-custom"``.
        actor: a planner (called with p) or a policy (with ``predict``).
        data: what it learnt from, in words; ``None`` where nothing was learnt.
        seconds: of the training without that of data; ``None`` where nothing was learnt.
    """

    name: str
    actor: Planner | Policy
    data: str | None = None
    seconds: float | None = None

    @property
    def planner(self) -> Planner | None:
        """The actor if it plans."""
        return None if isinstance(self.actor, Policy) else self.actor

    def policy(self, problem: OptimalControlProblem, dt: float, weights: TrackingWeights | None = None) -> Policy:
        """The actor as a policy on ``problem`` with control period ``dt``, seconds.

        ``weights`` of the tracking are the problem's own by default. A policy that plans by itself stays as it is.
        """
        if self.planner is not None:
            return TrackingPolicy(problem, self.planner, dt, weights)
        acting = cast(Policy, self.actor)
        if isinstance(acting, Stabiliser | PlanningPolicy) or problem.hold == 0:
            return acting
        return Stabilised(acting, problem, dt, weights)

    def fly(
        self,
        problem: OptimalControlProblem,
        parameters: Array,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> Episodes:
        """Episodes on ``problem`` from ``parameters`` (B, np) with control period ``dt``, seconds.

        ``weights`` of the tracking are the problem's own by default.
        """
        envs = environments(problem, min(len(parameters), BATCH), dt)
        episodes = rollout(envs, self.policy(problem, dt, weights), parameters)
        envs.close()
        return episodes
