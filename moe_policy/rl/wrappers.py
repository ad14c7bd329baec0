"""What a reinforcement learner sees and does: features of the observation, and actions in [-1, 1].

A learner gets the features φ(observation), in this order:

    sin(2π x_i / period_i), cos(2π x_i / period_i)      for a periodic state coordinate
    x_i / scale_i                                       for any other state coordinate
    2 (s_j − lower_j) / (upper_j − lower_j) − 1         for a context coordinate

and its action a ∈ [-1, 1]^nu stands for the control u = lower + (a + 1) (upper − lower) / 2. :class:`Features` and
:class:`Actions` are these two maps; the scalar and the vector wrappers, and the policies of :mod:`moe_policy.rl.actor`,
apply them and nothing else.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ocp_envs.problem import OptimalControlProblem

Float32 = NDArray[np.float32]


class Features:
    """φ: observations (..., nx + nc) → features (..., n) in float32; whole turns of an angle make no difference.

    Args:
        problem: the problem whose observations these are.
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        self.problem = problem
        state, context = problem.system.state, problem.context
        self._angles = np.flatnonzero(state.periods > 0)
        self._frequency = 2 * np.pi / state.periods[self._angles]
        self._linear = np.concatenate([np.flatnonzero(state.periods == 0), len(state) + np.arange(len(context))])
        middle = np.concatenate([np.zeros(len(state)), (context.lower + context.upper) / 2])
        scale = np.concatenate([state.scale, context.width / 2])
        self._middle, self._scale = middle[self._linear], scale[self._linear]
        lower = np.concatenate([state.lower, context.lower])[self._linear]
        upper = np.concatenate([state.upper, context.upper])[self._linear]
        # Observations are float32, so what is made of them may lie a step outside of its box.
        infinity, ones = np.float32(np.inf), np.ones(2 * len(self._angles), dtype=np.float32)
        lower = np.nextafter(((lower - self._middle) / self._scale).astype(np.float32), -infinity)
        upper = np.nextafter(((upper - self._middle) / self._scale).astype(np.float32), infinity)
        self.space = gym.spaces.Box(np.append(-ones, lower), np.append(ones, upper), dtype=np.float32)

    def __call__(self, observation: ArrayLike) -> Float32:
        values = np.asarray(observation, dtype=np.float64)
        expected = self.problem.system.nx + len(self.problem.context)
        if values.shape[-1:] != (expected,):
            raise ValueError(f"{self.problem.id}: expected observations (..., {expected}), got {values.shape}")
        angles = values[..., self._angles] * self._frequency
        linear = (values[..., self._linear] - self._middle) / self._scale
        pairs = np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(*angles.shape[:-1], -1)
        return np.concatenate([pairs, linear], axis=-1).astype(np.float32)


class Actions:
    """Actions (..., nu) in [-1, 1] ↔ controls (..., nu) in their box; actions outside are clipped.

    Args:
        problem: the problem whose controls these are.
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        box = problem.system.control
        self._lower, self._half = box.lower, box.width / 2
        self.space = gym.spaces.Box(-1.0, 1.0, (len(box),), dtype=np.float32)

    def controls(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Controls in physical units, float64."""
        return self._lower + (np.clip(np.asarray(actions, dtype=np.float64), -1, 1) + 1) * self._half

    def actions(self, controls: ArrayLike) -> NDArray[np.float64]:
        """The inverse of :meth:`controls` inside the box."""
        return (np.asarray(controls, dtype=np.float64) - self._lower) / self._half - 1


class FeatureObservation(gym.ObservationWrapper[Float32, Any, Any]):
    """An environment of :mod:`ocp_envs` observed through :class:`Features`."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._features = Features(env.unwrapped.problem)  # type: ignore[attr-defined]
        self.observation_space = self._features.space

    def observation(self, observation: Any) -> Float32:
        """Features (n,) of an observation (nx + nc,)."""
        return self._features(observation)


class NormalisedAction(gym.ActionWrapper[Any, Any, Any]):
    """An environment of :mod:`ocp_envs` with :class:`Actions` in [-1, 1]."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._actions = Actions(env.unwrapped.problem)  # type: ignore[attr-defined]
        self.action_space = self._actions.space

    def action(self, action: Any) -> NDArray[np.float64]:
        """The control (nu,) that an action (nu,) stands for."""
        return self._actions.controls(action)


class VectorFeatureObservation(gym.vector.VectorObservationWrapper[Any, Any, Any, Any]):
    """:class:`FeatureObservation` for a vector environment, in Gymnasium's modes NEXT_STEP and DISABLED."""

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._features = Features(env.unwrapped.problem)  # type: ignore[attr-defined]
        self.single_observation_space = self._features.space
        self.observation_space = batch_space(self._features.space, env.num_envs)

    def observations(self, observations: Any) -> Float32:
        """Features (num_envs, n) of observations (num_envs, nx + nc)."""
        return self._features(observations)


class VectorNormalisedAction(gym.vector.VectorActionWrapper[Any, Any, Any, Any]):
    """:class:`NormalisedAction` for a vector environment."""

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._actions = Actions(env.unwrapped.problem)  # type: ignore[attr-defined]
        self.single_action_space = self._actions.space
        self.action_space = batch_space(self._actions.space, env.num_envs)

    def actions(self, actions: Any) -> NDArray[np.float64]:
        """The controls (num_envs, nu) that actions (num_envs, nu) stand for."""
        return self._actions.controls(actions)


class VectorShapedReward(gym.vector.VectorWrapper):
    """Rewards scaled, shaped with a potential that falls with the distance to the goal, and less what violations cost.

    r' = k (max(r, −h) + γ Φ(x') − Φ(x) − d·e'·dt − c·v·dt),   Φ(x) = −w · e(x),   Φ = 0 after termination,

    e the goal error, e' and v that error and the violation of the path constraints after the step. Leaving the box
    costs more than anything else can; where that is hundreds of times the cost of an episode nothing else is learnt
    from, so h bounds it. The potential changes no policy's rank (Ng, Harada & Russell, *Policy invariance under reward
    transformations*, 1999); the price c makes the constraints felt, of which the cost knows nothing, and d the goal
    where it is too small to be entered by chance: with d the learner minimises another cost than the problem's.

    Args:
        env: a vector environment of :mod:`ocp_envs` made with ``autoreset_mode="Disabled"``, wrapped or not.
        scale: k > 0.
        weight: w ≥ 0, in units of cost per unit of goal error; 0 leaves the rewards unshaped.
        gamma: the learner's discount γ of one step.
        violation_price: c ≥ 0, cost per second and unit of violation; nothing without path constraints.
        largest_cost: h > 0, the most that one step costs the learner.
        distance_price: d ≥ 0, cost per second and unit of goal error.
    """

    def __init__(
        self,
        env: gym.vector.VectorEnv[Any, Any, Any],
        scale: float,
        weight: float,
        gamma: float,
        violation_price: float = 0.0,
        largest_cost: float = np.inf,
        distance_price: float = 0.0,
    ) -> None:
        super().__init__(env)
        self._scale, self._weight, self._gamma, self._largest_cost = scale, weight, gamma, largest_cost
        base: Any = env.unwrapped
        self._price = violation_price * base.dt if base.problem.n_clearances else 0.0
        self._distance_price = distance_price * base.dt
        self._before = np.zeros(env.num_envs)

    def _error(self) -> NDArray[np.float64]:
        base: Any = self.env.unwrapped
        return np.asarray(base.problem.goal_error(base.state))

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's own."""
        started = self.env.reset(seed=seed, options=options)
        self._before = -self._weight * self._error()
        return started

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """As the environment's own, with r' for r."""
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        error = np.where(terminated, 0.0, self._error())
        following = -self._weight * error
        gain = self._gamma * following - self._before - self._distance_price * error
        if self._price:
            gain = gain - self._price * info["violation"]
        self._before = following
        return (
            observations,
            self._scale * (np.maximum(rewards, -self._largest_cost) + gain),
            terminated,
            truncated,
            info,
        )


class VectorNearStarts(gym.vector.VectorWrapper):
    """Some episodes start between the goal and where they would have: at g + f (p − g) with f uniform in [0, 1].

    A curriculum without a schedule: short episodes teach what the long ones end with (compare Florensa et al., *Reverse
    curriculum generation for reinforcement learning*, 2017). The context stays as it is, and where the nearer start
    would violate the path constraints the episode starts at p. Only resets without ``parameters`` are changed.

    Args:
        env: a vector environment of :mod:`ocp_envs`, wrapped or not.
        share: probability of such a start, in [0, 1].
        seed: of the draws.
    """

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any], share: float, seed: int) -> None:
        super().__init__(env)
        self._problem: OptimalControlProblem = env.unwrapped.problem  # type: ignore[attr-defined]
        self._share, self._rng = share, np.random.default_rng(seed)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's own, with drawn parameters where none are given."""
        options = dict(options or {})
        if "parameters" not in options:
            problem, count, box = self._problem, self.num_envs, self._problem.parameters
            base: Any = self.env.unwrapped
            p = np.array([base.settings.draw_parameters(self._rng) for _ in range(count)])
            resting = problem.parameters_of(np.tile(problem.goal.state, (count, 1)), problem.start(p)[1])
            goal = np.clip(resting, box.lower, box.upper)
            fraction = np.where(self._rng.random(count) < self._share, self._rng.random(count), 1.0)
            nearer = goal + fraction[:, None] * (p - goal)
            if problem.n_clearances:
                (clearances,) = problem.batch_clearances()(*problem.start(nearer))
                nearer = np.where(clearances.min(axis=1, keepdims=True) >= 0, nearer, p)
            options["parameters"] = nearer
        return self.env.reset(seed=seed, options=options)
