"""Settings of reinforcement learners: they build a learner and extract its actor.

SAC: Haarnoja et al., *Soft actor-critic algorithms and applications* (2018). PPO: Schulman et al., *Proximal policy
optimization algorithms* (2017). TQC: Kuznetsov et al., *Controlling overestimation bias with truncated mixture of
continuous distributional quantile critics* (2020). SAC and PPO are those of Stable-Baselines3 and TQC that of its
companion sb3-contrib, imported when a learner is built.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import torch
from torch import nn

from moe_policy.rl.actor import Actor
from moe_policy.rl.common import RLSettings
from moe_policy.rl.encoding import actions_of
from ocp_envs.support.doors import checked

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from moe_policy.rl.vec_env import SB3VecEnv


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
            bias += torch.from_numpy(
                actions_of(problem, self.encoding(problem)).actions(problem.terminal.central_control)
            ).float()
        return learner

    def actor(self, learner: Any) -> Actor:
        return Actor.of_layers(self._layers(learner), "tanh", "clip")

    @staticmethod
    def _layers(learner: Any) -> list[nn.Linear]:
        policy = learner.policy
        return [*_linear(policy.mlp_extractor.policy_net), policy.action_net]

    def begin_with(self, learner: Any, actor: Actor) -> None:
        """Give the ``learner`` the weights of ``actor``, which has the layers of these settings."""
        layers = self._layers(learner)
        sizes = (layers[0].in_features, *(layer.out_features for layer in layers))
        if (actor.sizes, actor.activation, actor.squash) != (sizes, "tanh", "clip"):
            got = f"{actor.sizes}, {actor.activation} and {actor.squash}"
            raise ValueError(f"expected an actor of layers {sizes} with tanh, clipped, to begin with; got {got}")
        with torch.no_grad():
            for layer, weight, bias in zip(layers, actor.weights, actor.biases):
                layer.weight.copy_(torch.from_numpy(np.array(weight)))
                layer.bias.copy_(torch.from_numpy(np.array(bias)))


@checked
@dataclass(frozen=True, kw_only=True)
class ClonedPPOSettings(PPOSettings):
    """Proximal policy optimisation that begins with the actor that behaviour cloning has learnt.

    Args:
        critic_steps: decisions during which the critic alone learns, since that of the cloned actor is not known.
    """

    algorithm: ClassVar[str] = "ppo-bc"

    critic_steps: int = 0

    def after_step(self, learner: Any) -> None:
        policy, learns = learner.policy, learner.num_timesteps >= self.critic_steps
        if policy.log_std.requires_grad != learns:
            policy.log_std.requires_grad_(learns)
            for layer in self._layers(learner):
                layer.requires_grad_(learns)


def _linear(network: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in network if isinstance(layer, nn.Linear)]
