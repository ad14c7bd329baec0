"""What the policies of the library have in common: float32 actions for users, exact controls for rollouts, a check.

A policy *acts* in float64: :meth:`ModelPolicy.act` is what :func:`moe_policy.rollout` calls, with a mask of the
episodes that begin. :meth:`ModelPolicy.predict` is the same with the signature of Stable-Baselines3: its actions are in
the action space of the environment, and it watches its observations (:mod:`moe_policy.control.watch`), because those
who call it know nothing of :meth:`ModelPolicy.check`.
"""

from __future__ import annotations

from functools import cached_property
from types import NoneType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.control.fit import Environment, check_environment
from moe_policy.control.observations import Observations, beginning
from moe_policy.control.watch import Watch, Watched
from moe_policy.protocols import ExactPolicy, Policy, State
from ocp_envs.envs.interface import Interface
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked


class ModelPolicy:
    """A policy for the environments of ``problem`` with a control period of ``dt`` seconds."""

    problem: OptimalControlProblem
    dt: float
    #: The class of the recurrent state of :meth:`act`.
    recurrent: ClassVar[type] = NoneType

    def act(self, observations: NDArray[np.floating], state: State, begins: Bools) -> tuple[Array, State]:
        """The controls (B, nu) of one control step in float64, within their bounds, and the next recurrent state.

        ``observations`` are (B, nx + nc). ``state`` is the recurrent state that the last call returned, ``None`` at
        first; ``begins`` (B,) marks the episodes that begin now.
        """
        raise NotImplementedError

    def check(self, env: Environment) -> None:
        """Refuse an environment for which this policy is not made.

        That is one of another problem's coordinates, of another control period, or with a wrapper that changes what
        observations and actions mean, as far as their spaces tell. :func:`moe_policy.rollout` calls it; others do not.

        Args:
            env: an environment or a vector environment of :mod:`ocp_envs`, of Gymnasium or of Stable-Baselines3,
                wrapped or not.

        Raises:
            TypeError: another environment than one of :mod:`ocp_envs`.
            ValueError: the policy does not fit; the message says what differs, and what to do.
        """
        check_environment(self.interface, env)

    @cached_property
    def interface(self) -> Interface:
        """What an environment must show to fit."""
        return Interface.of(self.problem, self.dt)

    @cached_property
    def _observations(self) -> Observations:
        return Observations(self.problem)

    @cached_property
    def _watch(self) -> Watch:
        return Watch(self.problem, self.dt)

    @checked
    def predict(
        self,
        observation: ArrayLike,
        state: State = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], State]:
        """The actions of one control step, with the signature of Stable-Baselines3.

        An observation with a NaN gives NaN, which the environments report. Where the episode that ``episode_start``
        began is followed by an observation that cannot be its next one, the episode begins there: so the flags may be
        those of Gymnasium's ``autoreset_mode="NextStep"``, under which the observation of a finished episode comes
        with its end. The first control steps of an episode also show whether the environment has the control period
        and the actions of this policy.

        Args:
            observation: one observation (nx + nc,), or a batch (B, nx + nc).
            state: the recurrent state that the last call returned; ``None`` at first.
            episode_start: whether each episode of the batch starts now, (B,).
            deterministic: without effect: there is no other control.

        Returns:
            actions in the action space of the environment, (nu,) or (B, nu) in float32, and the recurrent state.

        Raises:
            TypeError: the recurrent state of another policy.
            ValueError: observations or flags of another shape, or observations that move as those of another
                environment.
        """
        values = self._observations(observation)
        begins, watched = beginning(episode_start, len(values)), Watched.of(state, len(values))
        seen, inner = watched.seen, watched.inner
        if len(seen.age) != len(values):
            raise ValueError(f"got {len(values)} observations with the recurrent state of {len(seen.age)} episodes")
        if not isinstance(inner, (self.recurrent, NoneType)):
            got = f"{type(inner).__name__}; give the state that the last call returned, or None at first"
            raise TypeError(f"state: expected a recurrent state of this policy, got {got}")
        watches = not seen.over or np.count_nonzero(begins) > 0
        restarted = self._watch.restarted(seen, values, begins) if watches else begins
        controls, inner = self.act(values, inner, begins | restarted if watches else begins)
        actions = controls.astype(np.float32)  # within the action space, since rounding keeps the order
        if inner is not None:
            if watches:
                seen = self._watch.following(seen, values, actions, begins, restarted)
            inner = Watched(inner, seen)
        return (actions[0] if np.ndim(observation) == 1 else actions), inner


def act(policy: Policy, observations: NDArray[np.floating], state: State, begins: Bools) -> tuple[Array, State]:
    """The controls (B, nu) of one control step, as exact as ``policy`` has them, and the next recurrent state.

    ``observations`` (B, nx + nc), ``state`` and ``begins`` (B,) are as for :meth:`ModelPolicy.act`.
    """
    own = isinstance(policy, ModelPolicy) and type(policy).predict is not ModelPolicy.predict  # what a user changed
    if isinstance(policy, ExactPolicy) and not own:
        return policy.act(observations, state, begins)
    action, state = policy.predict(observations, state=state, episode_start=begins, deterministic=True)
    return np.asarray(action, dtype=np.float64), state
