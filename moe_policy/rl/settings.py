"""Settings of reinforcement learners: they build a learner and extract its actor.

SAC: Haarnoja et al., *Soft actor-critic algorithms and applications* (2018). PPO: Schulman et al., *Proximal policy
optimization algorithms* (2017). TQC: Kuznetsov et al., *Controlling overestimation bias with truncated mixture of
continuous distributional quantile critics* (2020). SAC and PPO are those of Stable-Baselines3 and TQC that of its
companion sb3-contrib, imported when a learner is built.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from torch import nn

from moe_policy.rl.actor import Actor
from moe_policy.rl.features import Actions
from moe_policy.rl.wrappers import RewardShaping
from ocp_envs.support.doors import checked

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from moe_policy.rl.vec_env import SB3VecEnv


@checked
@dataclass(frozen=True, kw_only=True)
class RLSettings(RewardShaping):
    """What all learners have in common, including the shaping of their rewards.

    Args:
        steps: decisions to learn from, all environments together.
        period: seconds between two decisions.
        n_envs: environments that run in parallel.
        hidden: neurons of the hidden layers, of actor and critics alike.
        learning_rate: of Adam, falling linearly to ``final_learning_rate``.
        final_learning_rate: at the last step.
        batch_size: samples of one gradient step.
        evaluate_every: steps between two evaluations on the development parameters.
        near_starts: fraction of the training episodes with an initial state nearer to the goal than in the benchmark,
            see :class:`~moe_policy.rl.wrappers.VectorNearStarts`.
        seed: of everything random in the training.
    """

    algorithm: ClassVar[str]

    steps: int
    period: float = 0.1
    n_envs: int = 8
    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-4
    batch_size: int = 256
    evaluate_every: int = 10_000
    near_starts: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "hidden", tuple(self.hidden))
        for name in ("steps", "period", "n_envs", "learning_rate", "batch_size", "evaluate_every"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.near_starts <= 1:
            raise ValueError(f"near_starts must be in [0, 1], got {self.near_starts}")
        if not 0 <= self.final_learning_rate <= self.learning_rate:
            wanted = f"between 0 and learning_rate = {self.learning_rate}"
            raise ValueError(f"final_learning_rate must be {wanted}, got {self.final_learning_rate}")

    def rate(self, remaining: float) -> float:
        """Learning rate when the fraction ``remaining`` of the steps is left."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        """An untrained learner of Stable-Baselines3 (TQC: of sb3-contrib, else an ``ImportError``) on ``env``."""
        raise NotImplementedError

    def actor(self, learner: Any) -> Actor:
        """A copy of the actor of ``learner``, without its noise."""
        raise NotImplementedError


@checked
@dataclass(frozen=True, kw_only=True)
class SACSettings(RLSettings):
    """Soft actor-critic; the defaults are those of the shipped pendulum policy.

    Args:
        buffer_size: transitions in the replay buffer.
        learning_starts: random steps before the first gradient step.
        gradient_steps: gradient steps for every step of all environments together.
        tau: factor by which the target critics move towards the critics at each gradient step.
        entropy: weight of the entropy: a number, ``"auto"`` (tuned to an entropy of −1 nat for each control), or
            ``"auto_0.1"``, the same with the initial weight.
    """

    algorithm: ClassVar[str] = "sac"

    steps: int = 240_000
    buffer_size: int = 200_000
    learning_starts: int = 10_000
    gradient_steps: int = 4
    tau: float = 0.01
    entropy: str | float = "auto_0.1"

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        from stable_baselines3 import SAC

        return SAC("MlpPolicy", env, **self._arguments())

    def _arguments(self) -> dict[str, Any]:
        return {
            "learning_rate": self.rate,
            "buffer_size": self.buffer_size,
            "learning_starts": self.learning_starts,
            "batch_size": self.batch_size,
            "tau": self.tau,
            "gamma": self.gamma,
            "train_freq": 1,
            "gradient_steps": self.gradient_steps,
            "ent_coef": self.entropy,
            "policy_kwargs": {"net_arch": list(self.hidden)},
            "seed": self.seed,
            "device": "cpu",
        }

    def actor(self, learner: Any) -> Actor:
        network = learner.policy.actor
        return Actor.of_layers([*_linear(network.latent_pi), network.mu], "relu", "tanh")


@checked
@dataclass(frozen=True, kw_only=True)
class TQCSettings(SACSettings):
    """Truncated quantile critics: SAC whose two critics estimate 25 quantiles of the return each.

    Args:
        dropped: number of the highest quantiles of each critic that are left out.
    """

    algorithm: ClassVar[str] = "tqc"

    dropped: int = 2

    def learner(self, env: SB3VecEnv) -> BaseAlgorithm:
        try:
            from sb3_contrib import TQC
        except ImportError as error:
            raise ImportError(f"TQC needs sb3-contrib: pip install 'ocp-moe[tqc]' ({error})") from error

        learner: BaseAlgorithm = TQC("MlpPolicy", env, top_quantiles_to_drop_per_net=self.dropped, **self._arguments())
        return learner


#: SAC in a third of the steps, for a comparison that trains its learner within minutes.
SHORT_SAC = SACSettings(steps=80_000, gamma=0.99)


@checked
@dataclass(frozen=True, kw_only=True)
class PPOSettings(RLSettings):
    """Proximal policy optimisation on many environments at once; its first actions are near the goal's control.

    Of the common settings, ``n_envs``, ``learning_rate``, ``final_learning_rate``, ``batch_size`` and
    ``evaluate_every`` have defaults of their own.

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
        from stable_baselines3 import PPO

        learner = PPO(
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
        problem = env.get_attr("problem")[0]
        bias: Any = learner.policy.action_net.bias
        with torch.no_grad():
            bias += torch.from_numpy(Actions(problem).actions(problem.terminal.central_control)).float()
        return learner

    def actor(self, learner: Any) -> Actor:
        policy = learner.policy
        return Actor.of_layers([*_linear(policy.mlp_extractor.policy_net), policy.action_net], "tanh", "clip")


def _linear(network: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in network if isinstance(layer, nn.Linear)]


#: The settings of every algorithm.
ALGORITHMS: Mapping[str, type[SACSettings] | type[PPOSettings]] = MappingProxyType(
    {settings.algorithm: settings for settings in (SACSettings, PPOSettings, TQCSettings)}
)
