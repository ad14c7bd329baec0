"""Wrappers around the environments of :mod:`ocp_envs` for training.

Features and actions come from :mod:`moe_policy.rl.features`, once for a single and once for a vector environment.
:class:`VectorShapedReward` and :class:`VectorNearStarts` change the learner's reward and the initial
states of its episodes; policies are run without them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper, VectorWrapper
from gymnasium.vector.utils import batch_space

from moe_policy.rl.features import Actions, Features, Float32
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
    """``env`` of :mod:`ocp_envs`, wrapped or not, observed through :class:`~moe_policy.rl.features.Features`."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self._features = Features(_problem_of(env))
        self.observation_space = self._features.space

    def observation(self, observation: Float32) -> Float32:
        return self._features(observation)


class NormalisedAction(gym.ActionWrapper[Float32, Float32, Array]):
    """``env`` of :mod:`ocp_envs`, wrapped or not, with :class:`~moe_policy.rl.features.Actions` in [-1, 1]."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self._actions = Actions(_problem_of(env))
        self.action_space = self._actions.space

    def action(self, action: Float32) -> Array:
        return self._actions.controls(action)


class VectorFeatureObservation(VectorObservationWrapper[Float32, Array, Float32, Array]):
    """:class:`FeatureObservation` for a vector ``env``, in Gymnasium's modes NEXT_STEP and DISABLED."""

    def __init__(self, env: Environments) -> None:
        super().__init__(env)
        self._features = Features(base_of(env).problem)
        self.single_observation_space = self._features.space
        self.observation_space = batch_space(self._features.space, env.num_envs)

    def observations(self, observations: Float32) -> Float32:
        return self._features(observations)


class VectorNormalisedAction(VectorActionWrapper[Float32, Float32, Array, Array]):
    """:class:`NormalisedAction` for a vector ``env``."""

    def __init__(self, env: Environments) -> None:
        super().__init__(env)
        self._actions = Actions(base_of(env).problem)
        self.single_action_space = self._actions.space
        self.action_space = batch_space(self._actions.space, env.num_envs)

    def actions(self, actions: Float32) -> Array:
        return self._actions.controls(actions)


@dataclass(frozen=True, kw_only=True)
class RewardShaping:
    """How the rewards of a learner differ from those of the environment.

    With e the goal error, e' and v that error and the violation of the path constraints after the step,

        r' = k (max(r, −h) + γ Φ(x') − Φ(x) − d·e'·dt − c·v·dt),   Φ(x) = −w · e(x),   Φ = 0 after termination.

    The potential Φ does not change the ranking of policies (Ng, Harada & Russell, *Policy invariance under reward
    transformations*, 1999). Leaving the operating box costs more than any episode; where that is hundreds of times the
    cost of an episode nothing else is learnt, so h bounds it. The cost does not include path constraints: c prices
    them. Where the goal ball is too small to be entered by chance, d rewards approaching it; the learner then minimises
    another cost than the problem's.

    Args:
        reward_scale: k > 0.
        shaping: w ≥ 0, cost per unit of goal error; 0 leaves out the potential.
        gamma: the learner's discount γ of one step, in (0, 1].
        violation_price: c ≥ 0, cost per second and unit of violation; ineffective without path constraints.
        largest_cost: h > 0, the maximum cost of one step to the learner; ``None`` for no bound.
        distance_price: d ≥ 0, cost per second and unit of goal error.

    Raises:
        ValueError: a value out of its range, named.
    """

    gamma: float = 0.995
    reward_scale: float = 1.0
    shaping: float = 0.0
    violation_price: float = 0.0
    largest_cost: float | None = None
    distance_price: float = 0.0

    def __post_init__(self) -> None:
        if not self.reward_scale > 0:
            raise ValueError(f"reward_scale must be positive, got {self.reward_scale}")
        for name in ("shaping", "violation_price", "distance_price"):
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
        gain = shaping.gamma * self._potential - before - shaping.distance_price * dt * error
        if self._priced:
            gain = gain - shaping.violation_price * dt * info["violation"]
        shaped = shaping.reward_scale * (np.maximum(rewards, self._bound) + gain)
        return observations, shaped, terminated, truncated, info


class VectorNearStarts(VectorWrapper[Float32, Array, Float32, Array, Array]):
    """Some episodes start nearer to the goal: at g + f (p − g) instead of p, with f uniform in [0, 1].

    A curriculum without a schedule: short episodes teach what the long ones end with (compare Florensa et al., *Reverse
    curriculum generation for reinforcement learning*, 2017). The context stays as it is, and where the nearer initial
    state would violate the path constraints the episode starts at p. Only resets without ``parameters`` are changed.

    ``env`` is a vector environment, ``fraction`` the probability of such an initial state, ``seed`` that of the draws.
    """

    def __init__(self, env: Environments, fraction: float, seed: int) -> None:
        super().__init__(env)
        self._base, self._fraction, self._rng = base_of(env), fraction, np.random.default_rng(seed)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Float32, Info]:
        options = dict(options or {})
        if "parameters" not in options:
            options["parameters"] = self._draw()
        return self.env.reset(seed=seed, options=options)

    def _draw(self) -> Array:
        """Parameters of one episode for each environment, (num_envs, np)."""
        problem, count, box = self._base.problem, self.num_envs, self._base.problem.parameters
        p = self._base.options.draw_parameters([self._rng] * count)
        _, contexts = problem.start(p)
        resting = problem.parameters_of(problem.terminal.states(contexts), contexts)
        goal = np.clip(resting, box.lower, box.upper)
        factor = np.where(self._rng.random(count) < self._fraction, self._rng.random(count), 1.0)
        nearer = goal + factor[:, None] * (p - goal)
        if problem.n_clearances:
            (clearances,) = problem.functions.clearances()(*problem.start(nearer))
            nearer = np.where(clearances.min(axis=1, keepdims=True) >= 0, nearer, p)
        return nearer
