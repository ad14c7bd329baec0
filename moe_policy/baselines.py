"""Reinforcement learning as an opponent: SAC and PPO of Stable-Baselines3 on the environments of :mod:`ocp_envs`.

The learner sees features and acts in [-1, 1] (:mod:`moe_policy.wrappers`), at its own control period, in episodes that
end in the goal ball; the reward is −∫L dt of a step, so the undiscounted return is the very cost that the planners
minimise. Every so many steps the actor is run, without noise, on the development parameters in the common loop, at the
environment's own control period and with the stabiliser taking over in the goal ball: exactly as it will be judged. The
best actor is kept, by

    score = mean over the development parameters of  cost where the episode succeeds,
                                                      the largest cost rate × time limit where it fails,

which is what the environment charges for leaving its box at once. Lower is better.

Only :func:`train` needs Stable-Baselines3; its settings are in :mod:`moe_policy.learners`, running a policy is in
:mod:`moe_policy.actor`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.actor import LearnedPolicy, read_policy
from moe_policy.learners import SHORT_SAC, PPOSettings, RLSettings, SACSettings
from moe_policy.rollout import rollout
from moe_policy.tracking import Stabilised
from moe_policy.wrappers import (
    VectorFeatureObservation,
    VectorNearStarts,
    VectorNormalisedAction,
    VectorShapedReward,
)
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.simulation import largest_cost_rate

if TYPE_CHECKING:
    from moe_policy.vec_env import SB3VecEnv

__all__ = [
    "SHORT_SAC",
    "PPOSettings",
    "RLSettings",
    "SACSettings",
    "TrainingRun",
    "read_policy",
    "train",
    "training_env",
]

Array = NDArray[np.float64]


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
    """

    steps: int
    seconds: float
    success: int
    reached: int
    cost: float | None
    score: float


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
        from moe_policy.vec_env import SB3VecEnv
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
    rewarded = VectorShapedReward(
        envs, settings.reward_scale, settings.shaping, settings.gamma, settings.violation_price
    )
    return SB3VecEnv(VectorNormalisedAction(VectorFeatureObservation(rewarded)))


class _Judge:
    """Evaluates actors on the development parameters, in the common loop."""

    def __init__(self, problem: OptimalControlProblem, development: ArrayLike) -> None:
        self.problem = problem
        self.development = problem.check_parameters(development)
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
        failure = largest_cost_rate(self.problem) * self.problem.time_limit
        return Evaluation(
            steps=steps,
            seconds=round(time.perf_counter() - started, 1),
            success=int(episodes.success.sum()),
            reached=int(episodes.reached.sum()),
            cost=float(episodes.cost[episodes.success].mean()) if episodes.success.any() else None,
            score=float(np.where(episodes.success, episodes.cost, failure).mean()),
        )


def train(
    problem: OptimalControlProblem,
    settings: RLSettings,
    development: ArrayLike,
    *,
    on_evaluation: Callable[[TrainingRun], None] | None = None,
    details: Mapping[str, Any] | None = None,
) -> TrainingRun:
    """Train a policy and keep the best by development score.

    Args:
        problem: a problem that ``ocp_envs`` knows.
        settings: :class:`SACSettings` or :class:`PPOSettings`.
        development: parameters (B, np) on which the best actor is chosen.
        on_evaluation: called with the run so far after each evaluation, to report and to save.
        details: kept with the policy, as JSON.

    Raises:
        ImportError: Stable-Baselines3 is not installed.
    """
    env = training_env(problem, settings)
    learner, judge = settings.learner(env), _Judge(problem, development)
    started, run = time.perf_counter(), None

    def evaluate() -> TrainingRun:
        actor = settings.actor(learner)
        facts = {**(details or {}), "steps": learner.num_timesteps, "settings": asdict(settings)}
        policy = LearnedPolicy(problem, actor, period=settings.period, algorithm=settings.algorithm, details=facts)
        evaluation = judge(policy, learner.num_timesteps, started)
        if run is None or evaluation.score < run.best.score:
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
