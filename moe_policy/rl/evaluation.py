"""How a learner is evaluated during training: without noise, on the development parameters, as policies always are.

The actor acts at its own period in environments of the usual control period, and the stabiliser takes over in the goal
ball. The best evaluation has the lowest

    score = mean over the development parameters of  cost where the episode succeeds,
                                                      the largest cost rate × time limit where it fails,

and the environment charges the latter at once when the state leaves the operating box. Among evaluations without any
success the one with the highest mean return is the best.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import VectorWrapper
from numpy.typing import ArrayLike

from moe_policy.control.stabiliser import Stabilised
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.features import Float32
from moe_policy.rollouts.environments import Environments, base_of, environments
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from ocp_envs.envs.simulation import largest_cost_rate
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.kinds import AnyFloat


@checked
@dataclass(frozen=True, kw_only=True)
class Performance:
    """Metrics of episodes of a learner, or of any other policy.

    Args:
        success: episodes in the goal ball at the evaluation time.
        reached: episodes that entered the goal ball.
        cost: mean ∫L dt up to the goal ball over the successes, ``None`` without any.
        score: see the module; lower is better.
        cost_ratio: Σ cost / Σ optimal cost of the same parameters over the successes; ``None`` without any, or where
            no optimal costs are known. Episodes end at the edge of the goal ball and optimal trajectories in its
            centre, so the ratio of an optimal policy may be slightly below 1.
        mean_return: mean over all episodes of the undiscounted return as the environment charges it: −∫L dt up to the
            goal ball, up to the time limit where that is not entered, and the charge for leaving the box.
        violation: mean of the largest violation of the path constraints on the path; ``None`` without any.
        final_error: median of ‖x − goal‖ at the evaluation time, or where the episode left the box.
    """

    success: int
    reached: int
    cost: AnyFloat | None
    score: AnyFloat
    cost_ratio: AnyFloat | None
    mean_return: AnyFloat
    violation: AnyFloat | None
    final_error: AnyFloat

    @classmethod
    @checked
    def of(cls, problem: ProblemOrId, episodes: Episodes, optimal_costs: Array | None = None) -> Performance:
        """The metrics of ``episodes`` (B) on ``problem``, with the best known costs ``optimal_costs`` (B,)."""
        problem = problem_of(problem)
        won, failure = episodes.success, largest_cost_rate(problem) * problem.time_limit
        ratio = None
        if optimal_costs is not None and won.any():
            ratio = float(episodes.cost[won].sum() / optimal_costs[won].sum())
        return Performance(
            success=int(won.sum()),
            reached=int(episodes.reached.sum()),
            cost=float(episodes.cost[won].mean()) if won.any() else None,
            score=float(np.where(won, episodes.cost, failure).mean()),
            cost_ratio=ratio,
            mean_return=-float(episodes.cost.mean()),
            violation=float(episodes.violation.mean()) if problem.n_clearances else None,
            final_error=float(np.median(episodes.final_error)),
        )


@checked
@dataclass(frozen=True, kw_only=True)
class Evaluation(Performance):
    """The performance of an actor that has learnt from ``steps`` decisions, in ``seconds`` that include evaluations.

    ``closest`` is the closest approach: the median over the episodes of the smallest ‖x − goal‖ in them.
    """

    steps: int
    seconds: float
    closest: AnyFloat

    def better_than(self, other: Evaluation) -> bool:
        """Whether the score is lower than that of ``other``, or the return higher where the scores are equal."""
        return (self.score, -self.mean_return) < (other.score, -other.mean_return)


class ClosestApproach(VectorWrapper[Float32, Array, Float32, Array, Array]):
    """Vector ``envs`` that remember the smallest ‖x − goal‖ of each episode, ``closest`` (num_envs,)."""

    def __init__(self, envs: Environments) -> None:
        super().__init__(envs)
        self._base, self.closest = base_of(envs), np.full(envs.num_envs, np.inf)

    def _errors(self) -> Array:
        return self._base.problem.goal_error(self._base.state, self._base.context)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        begun = self.env.reset(seed=seed, options=options)
        self.closest = self._errors()
        return begun

    def step(self, actions: Array) -> tuple[Float32, Array, Array, Array, dict[str, Any]]:
        taken = self.env.step(actions)
        self.closest = np.minimum(self.closest, self._errors())
        return taken


class Evaluator:
    """Evaluates policies for ``problem`` on the ``development`` parameters (B, np); ``optimal_costs`` are (B,)."""

    def __init__(
        self, problem: OptimalControlProblem, development: ArrayLike, optimal_costs: ArrayLike | None = None
    ) -> None:
        self.problem = problem
        self.development = problem.check_parameters(development)
        self.optimal: Array | None = None
        if optimal_costs is not None:
            self.optimal = np.asarray(optimal_costs, dtype=np.float64)
            if self.optimal.shape != (len(self.development),) or not np.all(self.optimal > 0):
                wanted = f"one positive optimal cost for each of {len(self.development)} development parameters"
                got = f"shape {self.optimal.shape}, the smallest {self.optimal.min(initial=np.inf):.3g}"
                raise ValueError(f"{problem.id}: expected {wanted}, got {got}")
        self._envs = ClosestApproach(environments(problem, len(self.development)))
        self._began = time.perf_counter()

    def __call__(self, policy: LearnedPolicy, steps: int) -> Evaluation:
        """The evaluation of ``policy``, learnt from ``steps`` decisions."""
        evaluated = Stabilised(policy, self.problem, policy.dt) if self.problem.hold else policy
        episodes = rollout(self._envs, evaluated, self.development)
        performance = Performance.of(self.problem, episodes, self.optimal)
        seconds, closest = round(time.perf_counter() - self._began, 1), float(np.median(self._envs.closest))
        return Evaluation(steps=steps, seconds=seconds, closest=closest, **vars(performance))

    def close(self) -> None:
        """Close the environments."""
        self._envs.close()
