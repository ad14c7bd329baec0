"""Reinforcement learning as an opponent: SAC and PPO of Stable-Baselines3 on the environments of :mod:`ocp_envs`.

The learner sees features and acts in [-1, 1] (:mod:`moe_policy.wrappers`), at its own control period, in episodes that
end in the goal ball; the reward is −∫L dt of a step, so the undiscounted return is the very cost that the planners
minimise. Every so many steps the actor is run, without noise, on the development parameters in the common loop, at the
environment's own control period and with the stabiliser taking over in the goal ball: exactly as it will be judged. The
best actor is kept, by

    score = mean over the development parameters of  cost where the episode succeeds,
                                                      the largest cost rate × time limit where it fails,

which is what the environment charges for leaving its box at once. Lower is better.

SAC: Haarnoja et al., *Soft actor-critic algorithms and applications* (2018). PPO: Schulman et al., *Proximal policy
optimization algorithms* (2017). Only :func:`train` needs Stable-Baselines3.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import nn

from moe_policy.actor import Actor, LearnedPolicy, read_policy
from moe_policy.rollout import rollout
from moe_policy.tracking import Stabilised
from moe_policy.wrappers import VectorFeatureObservation, VectorNormalisedAction
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.simulation import largest_cost_rate

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from moe_policy.vec_env import SB3VecEnv

__all__ = ["PPOSettings", "RLSettings", "SACSettings", "TrainingRun", "read_policy", "train", "training_env"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RLSettings:
    """What SAC and PPO have in common.

    Args:
        steps: decisions to learn from, all environments together.
        period: seconds between two decisions.
        gamma: discount of one decision.
        n_envs: environments side by side.
        hidden: neurons of the hidden layers, of actor and critics alike.
        learning_rate: of Adam, falling linearly to ``final_learning_rate``.
        final_learning_rate: at the last step.
        batch_size: samples of one gradient step.
        evaluate_every: steps between two evaluations on the development parameters.
        seed: of everything random in the training.

    Raises:
        ValueError: a value out of its range, named.
    """

    algorithm: ClassVar[str]

    steps: int
    period: float = 0.1
    gamma: float = 0.995
    n_envs: int = 8
    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-3
    batch_size: int = 256
    evaluate_every: int = 10_000
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "hidden", tuple(self.hidden))
        for name in ("steps", "period", "n_envs", "learning_rate", "batch_size", "evaluate_every"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 < self.gamma <= 1:
            raise ValueError(f"gamma must be in (0, 1], got {self.gamma}")
        if not 0 <= self.final_learning_rate <= self.learning_rate:
            raise ValueError(
                f"final_learning_rate must be between 0 and learning_rate = {self.learning_rate}, "
                f"got {self.final_learning_rate}"
            )

    def rate(self, remaining: float) -> float:
        """Learning rate when the share ``remaining`` of the steps is left."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        """The untrained learner of Stable-Baselines3."""
        raise NotImplementedError

    def actor(self, learner: Any) -> Actor:
        """A copy of the learner's actor, without its noise."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class SACSettings(RLSettings):
    """Soft actor-critic; the defaults are those of the shipped pendulum policy.

    Args:
        buffer_size: transitions remembered.
        learning_starts: random steps before the first gradient step.
        gradient_steps: gradient steps for every step of all environments together.
        tau: share of the critics that moves into the target critics at each gradient step.
        entropy: weight of the entropy, ``"auto"`` (tuned to one nat of minus the number of controls) or a number.
    """

    algorithm: ClassVar[str] = "sac"

    steps: int = 150_000
    buffer_size: int = 200_000
    learning_starts: int = 2_000
    gradient_steps: int = 4
    tau: float = 0.01
    entropy: str | float = "auto"

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        """The untrained learner of Stable-Baselines3."""
        from stable_baselines3 import SAC

        return SAC(
            "MlpPolicy",
            env,
            learning_rate=self.rate,
            buffer_size=self.buffer_size,
            learning_starts=self.learning_starts,
            batch_size=self.batch_size,
            tau=self.tau,
            gamma=self.gamma,
            train_freq=1,
            gradient_steps=self.gradient_steps,
            ent_coef=self.entropy,
            policy_kwargs={"net_arch": list(self.hidden)},
            seed=self.seed,
            device="cpu",
        )

    def actor(self, learner: Any) -> Actor:
        """A copy of the learner's actor, without its noise."""
        network = learner.policy.actor
        return Actor.of_layers([*_linear(network.latent_pi), network.mu], "relu", "tanh")


@dataclass(frozen=True, kw_only=True)
class PPOSettings(RLSettings):
    """Proximal policy optimisation on many environments at once.

    Args:
        n_steps: steps of each environment between two updates.
        n_epochs: passes over them in an update.
        gae_lambda: weight of generalised advantage estimation.
        clip_range: bound of the probability ratio.
        entropy: weight of the entropy.
        log_std: logarithm of the initial standard deviation of actions.
    """

    algorithm: ClassVar[str] = "ppo"

    steps: int = 3_000_000
    n_envs: int = 64
    learning_rate: float = 3e-4
    final_learning_rate: float = 0.0
    batch_size: int = 1024
    evaluate_every: int = 100_000
    n_steps: int = 64
    n_epochs: int = 10
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy: float = 0.0
    log_std: float = 0.0

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        """The untrained learner of Stable-Baselines3."""
        from stable_baselines3 import PPO

        return PPO(
            "MlpPolicy",
            env,
            learning_rate=self.rate,
            n_steps=self.n_steps,
            batch_size=self.batch_size,
            n_epochs=self.n_epochs,
            gamma=self.gamma,
            gae_lambda=self.gae_lambda,
            clip_range=self.clip_range,
            ent_coef=self.entropy,
            policy_kwargs={"net_arch": list(self.hidden), "log_std_init": self.log_std},
            seed=self.seed,
            device="cpu",
        )

    def actor(self, learner: Any) -> Actor:
        """A copy of the learner's actor, without its noise."""
        policy = learner.policy
        return Actor.of_layers([*_linear(policy.mlp_extractor.policy_net), policy.action_net], "tanh", "clip")


def _linear(network: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in network if isinstance(layer, nn.Linear)]


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
    curve: tuple[Evaluation, ...] = field(default=())

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


def training_env(problem: OptimalControlProblem, n_envs: int, period: float, **arguments: Any) -> SB3VecEnv:
    """The registered ``problem`` as the learner sees it: features, actions in [-1, 1], one decision a step.

    Args:
        problem: a problem that ``ocp_envs`` knows.
        n_envs: episodes side by side.
        period: seconds between two decisions.
        arguments: further arguments of :class:`ocp_envs.Env`.
    """
    from moe_policy.vec_env import SB3VecEnv

    envs: Any = gym.make_vec(
        problem.id,
        num_envs=n_envs,
        vectorization_mode="vector_entry_point",
        dt=period,
        autoreset_mode="Disabled",
        **arguments,
    )
    return SB3VecEnv(VectorNormalisedAction(VectorFeatureObservation(envs)))


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
        ImportError: Stable-Baselines3 is not installed (``pip install ocp-moe[rl]``).
    """
    env = training_env(problem, settings.n_envs, settings.period)
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
