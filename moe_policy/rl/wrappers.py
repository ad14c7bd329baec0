"""Wrappers around the environments of :mod:`ocp_envs` for training.

Features and actions come from :mod:`moe_policy.rl.encoding`, once for a single and once for a vector environment.
:class:`VectorShapedReward` changes the learner's reward; policies are run without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper, VectorWrapper
from gymnasium.vector.utils import batch_space

from moe_policy.rl.actions import Actions
from moe_policy.rl.features import Features, Float32
from moe_policy.rollouts.environments import Environments, base_of
from ocp_envs.envs.env import Env
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

#: An environment of :mod:`ocp_envs`, wrapped or not.
Environment = gym.Env[Float32, Array]
#: What Gymnasium's environments tell besides observations and rewards.
Info = dict[str, Any]


def _problem_of(env: Environment) -> OptimalControlProblem:
    base = env.unwrapped
    if not isinstance(base, Env):
        raise TypeError(f"expected an environment of ocp_envs, wrapped or not; got {type(base).__name__}")
    return base.problem


class FeatureObservation(gym.ObservationWrapper[Float32, Array, Float32]):
    """``env`` of :mod:`ocp_envs`, wrapped or not, observed through ``features``, by default those without widths."""

    def __init__(self, env: Environment, features: Features | None = None) -> None:
        super().__init__(env)
        self._features = Features(_problem_of(env)) if features is None else features
        self.observation_space = self._features.space

    def observation(self, observation: Float32) -> Float32:
        return self._features(observation)


class NormalisedAction(gym.ActionWrapper[Float32, Float32, Array]):
    """``env`` of :mod:`ocp_envs`, wrapped or not, with ``actions`` in [-1, 1], by default over the whole box."""

    def __init__(self, env: Environment, actions: Actions | None = None) -> None:
        super().__init__(env)
        self._actions = Actions(_problem_of(env)) if actions is None else actions
        self.action_space = self._actions.space

    def action(self, action: Float32) -> Array:
        return self._actions.controls(action)


class VectorFeatureObservation(VectorObservationWrapper[Float32, Array, Float32, Array]):
    """:class:`FeatureObservation` with ``features`` for a vector ``env``, in the modes NEXT_STEP and DISABLED."""

    def __init__(self, env: Environments, features: Features | None = None) -> None:
        super().__init__(env)
        self._features = Features(base_of(env).problem) if features is None else features
        self.single_observation_space = self._features.space
        self.observation_space = batch_space(self._features.space, env.num_envs)

    def observations(self, observations: Float32) -> Float32:
        return self._features(observations)


class VectorNormalisedAction(VectorActionWrapper[Float32, Float32, Array, Array]):
    """:class:`NormalisedAction` with ``actions`` for a vector ``env``."""

    def __init__(self, env: Environments, actions: Actions | None = None) -> None:
        super().__init__(env)
        self._actions = Actions(base_of(env).problem) if actions is None else actions
        self.single_action_space = self._actions.space
        self.action_space = batch_space(self._actions.space, env.num_envs)

    def actions(self, actions: Float32) -> Array:
        return self._actions.controls(actions)


@dataclass(frozen=True, kw_only=True)
class RewardShaping:
    """How the rewards of a learner differ from those of the environment.

    With e the goal error, e' and v that error and the violation of the path constraints after the step, and a = 1 where
    it ends in the goal ball, else 0,

        r' = k (max(r, −h) + γ Φ(x') − Φ(x) − d·e'^q·dt − c·v·dt + b·a),   Φ(x) = −w · e(x),   Φ = 0 after termination.

    The potential Φ does not change the ranking of policies (Ng, Harada & Russell, *Policy invariance under reward
    transformations*, 1999). Leaving the operating box costs more than any episode; where that is hundreds of times the
    cost of an episode nothing else is learnt, so h bounds it. The cost does not include path constraints: c prices
    them. Where the goal ball is too small to be entered by chance, d rewards approaching it; the learner then minimises
    another cost than the problem's.
    Where entering the ball ends a small cost only, b makes it worthwhile.

    Args:
        reward_scale: k > 0.
        shaping: w ≥ 0, cost per unit of goal error; 0 leaves out the potential.
        gamma: the learner's discount γ of one step, in (0, 1].
        violation_price: c ≥ 0, cost per second and unit of violation; ineffective without path constraints.
        largest_cost: h > 0, the maximum cost of one step to the learner; ``None`` for no bound.
        distance_price: d ≥ 0, cost per second at a goal error of 1.
        distance_power: q > 0, by which the price grows with the goal error; below 1 it is steeper near the goal.
        arrival_bonus: b ≥ 0, reward for entering the goal ball.

    Raises:
        ValueError: a value out of its range, named.
    """

    gamma: float = 0.995
    reward_scale: float = 1.0
    shaping: float = 0.0
    violation_price: float = 0.0
    largest_cost: float | None = None
    distance_price: float = 0.0
    distance_power: float = 1.0
    arrival_bonus: float = 0.0

    def __post_init__(self) -> None:
        for name in ("reward_scale", "distance_power"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("shaping", "violation_price", "distance_price", "arrival_bonus"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must be at least 0, got {getattr(self, name)}")
        if self.largest_cost is not None and not self.largest_cost > 0:
            raise ValueError(f"largest_cost must be positive or None, got {self.largest_cost}")
        if not 0 < self.gamma <= 1:
            raise ValueError(f"gamma must be in (0, 1], got {self.gamma}")


class VectorShapedReward(VectorWrapper[Float32, Array, Float32, Array, Array]):
    """A vector ``env`` made with ``autoreset_mode="Disabled"``, with the rewards that ``shaping`` defines."""

    def __init__(self, env: Environments, shaping: RewardShaping) -> None:
        super().__init__(env)
        self._base, self._shaping = base_of(env), shaping
        self._bound = -np.inf if shaping.largest_cost is None else -shaping.largest_cost
        self._priced = shaping.violation_price > 0 and self._base.problem.n_clearances > 0
        self._potential = np.zeros(env.num_envs)

    def _error(self) -> Array:
        """Goal errors (num_envs,); zeros where they have neither weight nor price."""
        if self._shaping.shaping or self._shaping.distance_price:
            return self._base.problem.goal_error(self._base.state)
        return np.zeros(self.num_envs)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Float32, Info]:
        started = self.env.reset(seed=seed, options=options)
        self._potential = -self._shaping.shaping * self._error()
        return started

    def step(self, actions: Array) -> tuple[Float32, Array, Array, Array, Info]:
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        shaping, dt, before = self._shaping, self._base.dt, self._potential
        error = np.where(terminated, 0.0, self._error())
        self._potential = -shaping.shaping * error
        gain = shaping.gamma * self._potential - before - shaping.distance_price * dt * error**shaping.distance_power
        if self._priced:
            gain = gain - shaping.violation_price * dt * info["violation"]
        if shaping.arrival_bonus:
            gain = gain + shaping.arrival_bonus * np.logical_and(terminated, ~self._base.left_box)
        shaped = shaping.reward_scale * (np.maximum(rewards, self._bound) + gain)
        return observations, shaped, terminated, truncated, info
