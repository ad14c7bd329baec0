"""Policies that act on an estimate of the state: noise is filtered, a delay is predicted over, an offset is removed.

What a policy sees at control step k is the state at which its control will act, k + delay: the present state, as
measured or as estimated by a Kalman filter (:mod:`moe_policy.control.kalman`), and from there the model under the
controls that are on their way. With an estimated ``offset`` at the control, that is subtracted from the control. At the
beginning of an episode the control of the goal is on its way, as in the environments of :mod:`ocp_envs`; the policy
sees these control steps as well, so that the clock of a plan is that of the controls it makes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.control.fit import Environment
from moe_policy.control.kalman import Belief, KalmanFilter
from moe_policy.control.observations import split
from moe_policy.control.policy import ModelPolicy, act
from moe_policy.control.watch import Watched
from moe_policy.protocols import ExactPolicy, PlanningPolicy, Policy, Schedule, State
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked

#: With ``offset=True`` the disturbance at the control may change by this part of the control's range in a second.
_DRIFT = 0.1


@checked
@dataclass(frozen=True, eq=False)
class Estimating:
    """Recurrent state of :class:`Estimated` for B rows.

    Args:
        inner: that of the policy.
        belief: what is believed before the present observation.
        queue: the controls that act now and later, (delay + 1, B, nu); the first one acted in the last control step.
        fresh: the rows whose episode begins with the present observation, (B,).
    """

    inner: State
    belief: Belief
    queue: Array
    fresh: Bools


class Estimated(ModelPolicy):
    """A policy that acts on an estimate of the state.

    Args:
        policy: any policy for the same problem and control period.
        problem: the problem of the environment; by default that of the policy.
        dt: control period of the environment, seconds; by default that of the policy.
        delay: control steps by which controls act late, as in the environments, predicted with the model.
        noise: standard deviations of the measurements, one number or (nx,), as ``observation_noise`` of environments.
        disturbance: standard deviations of random derivatives of the state, one number or (nx,), as in environments.
        offset: whether a disturbance at the control is estimated and subtracted: integral action.

    Raises:
        TypeError: no policy, or numbers that are none.
        ValueError: no ``problem`` or ``dt`` where the policy has none, or an argument out of its range.
    """

    recurrent = Estimating

    @checked
    def __init__(
        self,
        policy: Policy,
        problem: ProblemOrId | None = None,
        dt: float | None = None,
        *,
        delay: int = 0,
        noise: ArrayLike = 0.0,
        disturbance: ArrayLike = 0.0,
        offset: bool = False,
    ) -> None:
        problem = getattr(policy, "problem", None) if problem is None else problem
        dt = getattr(policy, "dt", None) if dt is None else dt
        if problem is None or dt is None:
            raise ValueError(f"the policy {policy!r} has no problem or no control period; give problem=… and dt=…")
        self.policy, self.problem, self.dt = policy, problem_of(problem), float(dt)
        check_whole("delay", delay, 0)
        self.delay, self.offset = delay, offset
        self.noise, self.disturbance = self._deviations("noise", noise), self._deviations("disturbance", disturbance)
        drift = (_DRIFT if offset else 0.0) * self.problem.system.control.width
        self._filter = KalmanFilter(self.problem, self.dt, self.noise, self.disturbance, drift)
        self._filters = offset or bool(self.noise.any())

    def _deviations(self, name: str, value: ArrayLike) -> Array:
        nx = self.problem.system.nx
        values = np.asarray(value, dtype=np.float64)
        if values.shape not in ((), (nx,)) or not np.isfinite(values).all() or (values < 0).any():
            raise ValueError(f"{name}: expected standard deviations ≥ 0, one number or {nx}, got {value!r}")
        return np.array(np.broadcast_to(values, (nx,)))

    def check(self, env: Environment) -> None:
        super().check(env)
        if isinstance(self.policy, ExactPolicy):
            self.policy.check(env)

    @checked
    def start(self, parameters: ArrayLike) -> Estimating:
        """The recurrent state before the first control step of episodes with ``parameters`` (B, np) or (np,).

        Raises:
            ValueError: parameters of another shape, or plans of another problem's.
        """
        p = self.problem.check_parameters(parameters, extrapolate=True)
        states, contexts = self.problem.start(p)
        inner = self.policy.start(p) if isinstance(self.policy, PlanningPolicy) else None
        return self._begun(inner, states, contexts)

    def schedule(self, state: State) -> Schedule | None:
        """When the plans of a recurrent ``state`` end and are evaluated; ``None`` for a policy without plans."""
        own: Estimating = state.inner if isinstance(state, Watched) else state
        return self.policy.schedule(own.inner) if isinstance(self.policy, PlanningPolicy) else None

    def act(
        self, observations: NDArray[np.floating], state: Estimating | None, begins: Bools
    ) -> tuple[Array, Estimating]:
        observed, contexts = split(self.problem, observations)
        told = begins
        if state is None:
            state = self._begun(None, observed, contexts)
        elif np.count_nonzero(begins):
            state, told = self._restarted(state, begins, observed, contexts)
        belief = self._believed(state, observed, contexts)
        states = belief.states
        for controls in state.queue[1:]:
            states = self._filter.predicted(states, controls + belief.offset, contexts)
        wanted, inner = act(self.policy, np.concatenate([states, contexts], axis=1), state.inner, told)
        box = self.problem.system.control
        controls = np.clip(wanted - belief.offset, box.lower, box.upper)
        queue = np.concatenate([state.queue[1:], controls[None]])
        return controls, Estimating(inner, belief, queue, np.zeros(len(observed), bool))

    def _begun(self, inner: State, states: Array, contexts: Array) -> Estimating:
        """The recurrent state at the beginning of episodes at ``states`` (B, nx) in ``contexts`` (B, nc).

        ``inner`` is that of the policy then, if it has one. It sees the control steps in which it cannot act yet.
        """
        size, held, seen = len(states), self.problem.terminal.controls(contexts), states
        for _ in range(self.delay):
            observations = np.concatenate([seen, contexts], axis=1)
            _, inner = act(self.policy, observations, inner, np.full(size, inner is None))
            seen = self._filter.predicted(seen, held, contexts)
        queue = np.tile(held, (self.delay + 1, 1, 1))
        return Estimating(inner, self._filter.begun(states), queue, np.ones(size, bool))

    def _restarted(
        self, state: Estimating, begins: Bools, observed: Array, contexts: Array
    ) -> tuple[Estimating, Bools]:
        """``state`` in which the rows of the mask ``begins`` (B,) begin, and the beginnings that the policy is told.

        They are ``observed`` (B, nx) in ``contexts`` (B, nc).
        """
        new, queue = self._begun(None, observed[begins], contexts[begins]), state.queue.copy()
        queue[:, begins] = new.queue
        inner, told = state.inner, begins
        if hasattr(new.inner, "restarted"):  # a clock that has begun to run
            inner, told = state.inner.restarted(begins, new.inner), np.zeros_like(begins)
        return Estimating(inner, state.belief.replaced(begins, new.belief), queue, state.fresh | begins), told

    def _believed(self, state: Estimating, observed: Array, contexts: Array) -> Belief:
        """What is believed when states are ``observed`` (B, nx) in ``contexts`` (B, nc), with the ``state`` before."""
        if not self._filters:
            return replace(state.belief, states=observed)
        if state.fresh.all():
            return state.belief.replaced(state.fresh, self._filter.begun(observed))
        belief = self._filter(state.belief, state.queue[0], contexts, observed)
        if not state.fresh.any():
            return belief
        return belief.replaced(state.fresh, self._filter.begun(observed[state.fresh]))

    def __repr__(self) -> str:
        told = f"delay={self.delay}, noise={self.noise.any()}, offset={self.offset}"
        return f"Estimated({self.policy!r}, {self.problem.id!r}, {told}, dt={self.dt})"
