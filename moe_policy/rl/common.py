"""Settings that all learners have in common, and those that reinforcement learners do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from moe_policy.rl.actor import Actor
from moe_policy.rl.encoding import Encoding, encoding_of
from moe_policy.rl.wrappers import RewardShaping
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.doors import checked

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from moe_policy.rl.vec_env import SB3VecEnv


@checked
@dataclass(frozen=True, kw_only=True)
class LearnerSettings:
    """What all learners have in common, whatever they learn from.

    Args:
        steps: decisions to learn from, all environments together.
        period: seconds between two decisions.
        hidden: neurons of the hidden layers, of actor and critics alike.
        learning_rate: of Adam, falling linearly to ``final_learning_rate``.
        final_learning_rate: at the last step.
        batch_size: samples of one gradient step.
        near_goal: number of features near the goal for each coordinate, see :mod:`moe_policy.rl.features`.
        stride: of actions round the goal, see :mod:`moe_policy.rl.actions`, one number or one for each direction; 0
            for actions over the whole box.
        seed: of everything random in the training.

    Raises:
        ValueError: a value out of its range, named.
    """

    algorithm: ClassVar[str]

    steps: int = 1_000_000
    period: float = 0.1
    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-4
    batch_size: int = 256
    near_goal: int = 0
    stride: float | tuple[float, ...] = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "hidden", tuple(self.hidden))
        for name in ("steps", "period", "learning_rate", "batch_size"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("near_goal", "stride"):
            if not np.all(np.array(getattr(self, name)) >= 0):
                raise ValueError(f"{name} must be at least 0, got {getattr(self, name)}")
        if not 0 <= self.final_learning_rate <= self.learning_rate:
            wanted = f"between 0 and learning_rate = {self.learning_rate}"
            raise ValueError(f"final_learning_rate must be {wanted}, got {self.final_learning_rate}")

    def rate(self, remaining: float) -> float:
        """Learning rate when the fraction ``remaining`` of the steps is left."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)

    def complete(self, steps: int) -> bool:
        """Whether a training that has learnt from ``steps`` decisions is complete."""
        return steps >= self.steps

    def encoding(self, problem: OptimalControlProblem) -> Encoding:
        """The encoding of features and actions of a learner of ``problem``."""
        return encoding_of(problem, self.near_goal, self.stride, self.period)


@checked
@dataclass(frozen=True, kw_only=True)
class RLSettings(RewardShaping, LearnerSettings):
    """What all reinforcement learners have in common, including the shaping of their rewards.

    Args:
        n_envs: environments that run in parallel.
        evaluate_every: steps between two evaluations on the development parameters.
        near_starts: fraction of the training episodes with an initial state nearer to the goal than in the benchmark,
            see :class:`~moe_policy.rl.curriculum.VectorNearStarts`.
        nearness: how close to the goal these initial states lie, 1 or more.
        moving_starts: by how much of their scales the other coordinates deviate in these initial states.
        first_radius: radius of the goal ball at first, which shrinks to that of the problem, see
            :class:`~moe_policy.rl.curriculum.VectorShrinkingGoal`; 0 for that of the problem from the beginning.
    """

    n_envs: int = 8
    evaluate_every: int = 10_000
    near_starts: float = 0.0
    nearness: float = 1.0
    moving_starts: float = 0.0
    first_radius: float = 0.0

    def __post_init__(self) -> None:
        RewardShaping.__post_init__(self)
        LearnerSettings.__post_init__(self)
        for name in ("n_envs", "evaluate_every", "nearness"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("moving_starts", "first_radius"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must be at least 0, got {getattr(self, name)}")
        if not 0 <= self.near_starts <= 1:
            raise ValueError(f"near_starts must be in [0, 1], got {self.near_starts}")

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        """An untrained learner of Stable-Baselines3 (TQC: of sb3-contrib, else an ``ImportError``) on ``env``."""
        raise NotImplementedError

    def actor(self, learner: Any) -> Actor:
        """A copy of the actor of ``learner``, without its noise."""
        raise NotImplementedError

    def after_step(self, learner: Any) -> None:
        """Called after each step of the environments with the ``learner``; by default nothing follows."""
