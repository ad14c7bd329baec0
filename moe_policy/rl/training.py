"""Reinforcement learning as an opponent: SAC and PPO of Stable-Baselines3 on the environments of :mod:`ocp_envs`.

The learner sees features and acts in [-1, 1] (:mod:`moe_policy.rl.wrappers`), at its own control period, in episodes
that end in the goal ball; the reward is −∫L dt of a step, so the undiscounted return is the very cost that the planners
minimise. Every so many steps the actor is run, without noise, on the development parameters in the common loop, at the
environment's own control period and with the stabiliser taking over in the goal ball: exactly as it will be judged. The
best actor is kept, by

    score = mean over the development parameters of  cost where the episode succeeds,
                                                      the largest cost rate × time limit where it fails,

which is what the environment charges for leaving its box at once. Lower is better. Among actors without any success
the one with the highest mean return is kept.

Only :func:`train` needs Stable-Baselines3; its settings are in :mod:`moe_policy.rl.settings`, running a policy is in
:mod:`moe_policy.rl.actor`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.tracking import Stabilised
from moe_policy.rl.actor import LearnedPolicy, read_policy
from moe_policy.rl.settings import SHORT_SAC, PPOSettings, RLSettings, SACSettings
from moe_policy.rl.wrappers import (
    VectorFeatureObservation,
    VectorNearStarts,
    VectorNormalisedAction,
    VectorShapedReward,
)
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from ocp_envs.envs.simulation import largest_cost_rate
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from moe_policy.rl.vec_env import SB3VecEnv

__all__ = [
    "SHORT_SAC",
    "PPOSettings",
    "RLSettings",
    "SACSettings",
    "TrainingRun",
    "figures_of",
    "read_policy",
    "train",
    "training_env",
]


@dataclass(frozen=True)
class Evaluation:
    """The actor on the development parameters.

    Args:
        steps: decisions learnt from until then.
        seconds: wall time of the training until then, earlier evaluations included.
        success: episodes in the goal ball after the hold.
        reached: episodes that entered the goal ball.
        cost: mean ∫L dt up to the goal ball over the successes, ``None`` without any.
        score: see the module; lower is better.
        cost_ratio: Σ cost / Σ optimal cost of the same starts over the successes; ``None`` without any, or where no
            optimal costs are known. Episodes end at the edge of the goal ball and the optimum in its centre, so that
            an optimal policy may be somewhat below 1.
        mean_return: mean over all episodes of the undiscounted return as the environment charges it: −∫L dt up to the
            goal ball, up to the time limit where that is not entered, and with what leaving the box costs. ``None`` in
            records from before it was kept.
        violation: mean of the largest violation of the path constraints on the path; ``None`` without any.
        final_error: median of ‖x − goal‖ at the judgement, or where the episode left the box; ``None`` as above.
    """

    steps: int
    seconds: float
    success: int
    reached: int
    cost: float | None
    score: float
    cost_ratio: float | None = None
    mean_return: float | None = None
    violation: float | None = None
    final_error: float | None = None

    def better_than(self, other: Evaluation) -> bool:
        """By score; by return where the scores are equal."""
        least = float("-inf")
        returns = [least if e.mean_return is None else e.mean_return for e in (self, other)]
        return (self.score, -returns[0]) < (other.score, -returns[1])


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """A training so far: the best policy, which evaluation it is from, and all evaluations."""

    settings: RLSettings
    policy: LearnedPolicy
    best: Evaluation
    curve: tuple[Evaluation, ...] = ()

    def record(self) -> dict[str, Any]:
        """Settings and training curve as JSON."""
        return {
            "algorithm": self.settings.algorithm,
            "settings": asdict(self.settings),
            "steps": self.curve[-1].steps,
            "seconds": self.curve[-1].seconds,
            "best": asdict(self.best),
            "curve": [asdict(evaluation) for evaluation in self.curve],
        }


def training_env(problem: OptimalControlProblem, settings: RLSettings, **arguments: Any) -> SB3VecEnv:
    """The registered ``problem`` as the learner sees it: features, actions in [-1, 1], one decision a step.

    Args:
        problem: a problem that ``ocp_envs`` knows.
        settings: number of episodes side by side, seconds between two decisions, and what is done to rewards.
        arguments: further arguments of :class:`ocp_envs.Env`.

    Raises:
        ImportError: Stable-Baselines3 is not installed.
    """
    try:
        from moe_policy.rl.vec_env import SB3VecEnv
    except ImportError as error:
        raise ImportError(f"training needs Stable-Baselines3: pip install 'ocp-moe[rl]' ({error})") from error

    envs: Any = gym.make_vec(
        problem.id,
        num_envs=settings.n_envs,
        vectorization_mode="vector_entry_point",
        dt=settings.period,
        autoreset_mode="Disabled",
        **arguments,
    )
    if settings.near_starts:
        envs = VectorNearStarts(envs, settings.near_starts, settings.seed)
    largest_cost = np.inf if settings.largest_cost is None else settings.largest_cost
    rewarded = VectorShapedReward(
        envs,
        settings.reward_scale,
        settings.shaping,
        settings.gamma,
        settings.violation_price,
        largest_cost,
        settings.distance_price,
    )
    return SB3VecEnv(VectorNormalisedAction(VectorFeatureObservation(rewarded)))


def figures_of(
    problem: OptimalControlProblem, episodes: Episodes, optimal_costs: Array | None = None
) -> dict[str, Any]:
    """What an :class:`Evaluation` says of ``episodes``, of a learner or of anybody else.

    Args:
        problem: the problem they ran on.
        episodes: B of them.
        optimal_costs: best known costs of their starts, (B,).
    """
    won, failure = episodes.success, largest_cost_rate(problem) * problem.time_limit
    ratio = None
    if optimal_costs is not None and won.any():
        ratio = float(episodes.cost[won].sum() / optimal_costs[won].sum())
    return {
        "success": int(won.sum()),
        "reached": int(episodes.reached.sum()),
        "cost": float(episodes.cost[won].mean()) if won.any() else None,
        "score": float(np.where(won, episodes.cost, failure).mean()),
        "cost_ratio": ratio,
        "mean_return": -float(episodes.cost.mean()),
        "violation": float(episodes.violation.mean()) if problem.n_clearances else None,
        "final_error": float(np.median(episodes.final_error)),
    }


class _Judge:
    """Evaluates actors on the development parameters, in the common loop."""

    def __init__(
        self, problem: OptimalControlProblem, development: ArrayLike, optimal_costs: ArrayLike | None = None
    ) -> None:
        self.problem = problem
        self.development = problem.check_parameters(development)
        self.optimal: Array | None = None
        if optimal_costs is not None:
            self.optimal = np.asarray(optimal_costs, dtype=np.float64)
            if self.optimal.shape != (len(self.development),) or not np.all(self.optimal > 0):
                raise ValueError(
                    f"{problem.id}: expected one positive optimal cost for each of {len(self.development)} development "
                    f"parameters, got {self.optimal.size} of shape {self.optimal.shape}, the smallest "
                    f"{self.optimal.min(initial=np.inf):.3g}"
                )
        self.envs = gym.make_vec(
            problem.id,
            num_envs=len(self.development),
            vectorization_mode="vector_entry_point",
            terminate_at_goal=False,
            autoreset_mode="Disabled",
        )

    def __call__(self, policy: LearnedPolicy, steps: int, started: float) -> Evaluation:
        judged = Stabilised(policy, self.problem, policy.dt) if self.problem.hold else policy
        episodes = rollout(self.envs, judged, self.development)
        return Evaluation(
            steps=steps,
            seconds=round(time.perf_counter() - started, 1),
            **figures_of(self.problem, episodes, self.optimal),
        )


def train(
    problem: OptimalControlProblem,
    settings: RLSettings,
    development: ArrayLike,
    *,
    optimal_costs: ArrayLike | None = None,
    on_evaluation: Callable[[TrainingRun], None] | None = None,
    details: Mapping[str, Any] | None = None,
) -> TrainingRun:
    """Train a policy and keep the best by development score.

    Args:
        problem: a problem that ``ocp_envs`` knows.
        settings: :class:`SACSettings` or :class:`PPOSettings`.
        development: parameters (B, np) on which the best actor is chosen.
        optimal_costs: the best known cost of each of them, (B,), for ratios of costs; nothing is chosen by it.
        on_evaluation: called with the run so far after each evaluation, to report and to save.
        details: kept with the policy, as JSON.

    Raises:
        ImportError: Stable-Baselines3 is not installed.
        ValueError: parameters or optimal costs that are no use.
    """
    judge = _Judge(problem, development, optimal_costs)
    env = training_env(problem, settings)
    learner = settings.learner(env)
    started, run = time.perf_counter(), None

    def evaluate() -> TrainingRun:
        actor = settings.actor(learner)
        facts = {**(details or {}), "steps": learner.num_timesteps, "settings": asdict(settings)}
        policy = LearnedPolicy(problem, actor, period=settings.period, algorithm=settings.algorithm, details=facts)
        evaluation = judge(policy, learner.num_timesteps, started)
        if run is None or evaluation.better_than(run.best):
            return TrainingRun(settings, policy, evaluation, (*(run.curve if run else ()), evaluation))
        return replace(run, curve=(*run.curve, evaluation))

    def after_step(local: dict[str, Any], world: dict[str, Any]) -> bool:
        nonlocal run
        done = run.curve[-1].steps if run else 0
        if learner.num_timesteps // settings.evaluate_every > done // settings.evaluate_every:
            run = evaluate()
            if on_evaluation is not None:
                on_evaluation(run)
        return True

    learner.learn(settings.steps, callback=after_step)
    if run is None or run.curve[-1].steps < learner.num_timesteps:
        run = evaluate()
        if on_evaluation is not None:
            on_evaluation(run)
    env.close()
    judge.envs.close()
    return run
