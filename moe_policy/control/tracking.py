"""Policies that follow a plan and hold the goal.

Within a plan, at tick k after its start, with the reference x̄, ū of :mod:`moe_policy.control.resampling` and the
gains K of :mod:`moe_policy.control.lqr`,

    u = the control of the box nearest to ū_k − K_k (x ⊖ x̄_k) in the metric H_k,

where ⊖ takes periodic coordinates the short way round. After the plan x̄ is the goal, ū the control that holds it and K
the gain of the discrete regulator there; where a goal cannot be held K = 0, so ū is simply kept. That makes the hold
nothing but one more row of the arrays: the tick is clipped at the last row.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.control.lqr import Regulator, TrackingWeights, nearest_control
from moe_policy.control.resampling import Resampler
from moe_policy.protocols import Planner, Policy, Schedule
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Tracking:
    """Recurrent state of :class:`TrackingPolicy`: the plans on the control clock, the gains and the clock, for B rows.

    Args:
        states: references (B, T+1, nx); from a plan's last tick on, the goal.
        controls: feed-forward (B, T+1, nu); from a plan's last tick on, the goal's control.
        gains: (B, T+1, nu, nx); from a plan's last tick on, the gain of the hold.
        metrics: (B, T+1, nu, nu), in which controls are brought into their box; then that of the hold.
        clock: ticks since each plan's start, (B,).
        schedule: see :class:`Schedule`.
    """

    states: Array
    controls: Array
    gains: Array
    metrics: Array
    clock: NDArray[np.int64]
    schedule: Schedule

    def replaced(self, rows: NDArray[np.bool_], new: Tracking) -> Tracking:
        """This state with the ``rows`` of a mask (B,) taken from ``new``, whose batch is those rows."""
        longest = max(self.states.shape[1], new.states.shape[1])

        def merge(old: NDArray[Any], fresh: NDArray[Any]) -> NDArray[Any]:
            merged = old.copy()
            merged[rows] = fresh
            return merged

        def merge_ticks(old: Array, fresh: Array) -> Array:
            return merge(_padded(old, longest), _padded(fresh, longest))

        schedule = {
            f.name: merge(getattr(self.schedule, f.name), getattr(new.schedule, f.name))
            for f in dataclasses.fields(Schedule)
        }
        return Tracking(
            states=merge_ticks(self.states, new.states),
            controls=merge_ticks(self.controls, new.controls),
            gains=merge_ticks(self.gains, new.gains),
            metrics=merge_ticks(self.metrics, new.metrics),
            clock=merge(self.clock, new.clock),
            schedule=Schedule(**schedule),
        )


def _padded(values: Array, length: int) -> Array:
    """``values`` (B, T, …) with the last of axis 1 repeated up to ``length``."""
    return np.concatenate([values, np.repeat(values[:, -1:], length - values.shape[1], axis=1)], axis=1)


def _split(problem: OptimalControlProblem, observation: ArrayLike) -> tuple[Array, Array]:
    """States (B, nx) and contexts (B, nc) of observations (B, nx + nc)."""
    values = np.asarray(observation, dtype=np.float64)
    nx, nc = problem.system.nx, len(problem.context)
    if values.ndim != 2 or values.shape[1] != nx + nc:
        raise ValueError(
            f"{problem.id}: expected observations (state, context) of shape (B, {nx + nc}) or ({nx + nc},), "
            f"got {np.shape(observation)}"
        )
    return values[:, :nx], values[:, nx:]


def _flags(episode_start: ArrayLike | None, size: int) -> NDArray[np.bool_]:
    return np.zeros(size, bool) if episode_start is None else np.broadcast_to(np.asarray(episode_start, bool), size)


class TrackingPolicy:
    """Turns a planner into a policy: plan at the start of an episode, track the plan, hold the goal.

    Args:
        problem: the problem of the environment.
        planner: parameters (B, np) → Trajectory.
        dt: control period of the environment, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.

    A plan is moved into the boxes before it is tracked (its duration into ``problem.duration``: counted). A plan that
    is not finite, or has no finite gains, is rejected and counted: its row holds the goal from the start. Nothing
    raises for parameters outside their box, and no action is ever NaN while the observation is not.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        planner: Planner,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> None:
        self.problem, self.planner = problem, planner
        self.regulator = Regulator(problem, dt, weights)
        self.dt = self.regulator.dt
        self._resample = Resampler(problem, self.dt)

    def start(self, parameters: ArrayLike) -> Tracking:
        """Plan for ``parameters`` (B, np), in float64, and prepare the tracking: the recurrent state before tick 0."""
        p = np.array(parameters, dtype=np.float64, ndmin=2)
        width = len(self.problem.parameters)
        if p.shape[1:] != (width,):
            raise ValueError(f"{self.problem.id}: expected parameters (B, {width}), got {np.shape(parameters)}")
        return self.follow(self.planner(p), self.problem.start(p)[1])

    def follow(self, plan: Trajectory, contexts: Array) -> Tracking:
        """The recurrent state before tick 0 of tracking ``plan`` (B plans) in ``contexts`` (B, nc)."""
        problem = self.problem
        expected = (len(contexts), problem.system.nx, problem.system.nu)
        got = (len(plan), plan.states.shape[2], plan.controls.shape[2])
        if got != expected:
            raise ValueError(
                f"{problem.id}: the planner must return {expected[0]} plans of {expected[1]} states and "
                f"{expected[2]} controls, got {got[0]} of {got[1]} and {got[2]}"
            )
        rejected = ~plan.finite
        shortest, longest = problem.duration
        clipped = ~rejected & ((plan.duration < shortest) | (plan.duration > longest))
        plan = self._into_boxes(plan, rejected)
        reference = self._resample(plan, contexts)
        # Between wild knots the interpolation overshoots, out of the box and into singularities of the dynamics.
        box = problem.system.state
        inside = np.clip(reference.states, box.lower, box.upper)
        gains, metrics = self.regulator.along(inside, reference.controls, contexts, reference.ticks)
        rejected |= ~np.isfinite(gains).all(axis=(1, 2, 3))

        ticks = np.where(rejected, 0, reference.ticks)
        after = np.arange(gains.shape[1]) >= ticks[:, None]
        states = np.where(after[..., None], problem.goal.state, inside)
        controls = np.where(after[..., None], problem.goal.control, _padded(reference.controls, gains.shape[1]))
        gains[after], metrics[after] = self.regulator.hold, self.regulator.hold_metric
        plan_end = ticks * self.dt
        knot_step = np.where(rejected, np.nan, plan.step)
        schedule = Schedule(plan_end, plan_end + problem.hold, knot_step, clipped & ~rejected, rejected)
        return Tracking(states, controls, gains, metrics, np.zeros(len(plan), np.int64), schedule)

    def _into_boxes(self, plan: Trajectory, rejected: NDArray[np.bool_]) -> Trajectory:
        """The plans moved into the boxes of the problem; rejected ones replaced by the shortest stay at the goal."""
        problem = self.problem
        row = rejected[:, None, None]
        states = np.where(row, problem.goal.state, plan.states)
        controls = np.where(row, problem.goal.control, plan.controls)
        duration = np.where(rejected, problem.duration[0], plan.duration)
        return Trajectory(
            np.clip(states, problem.system.state.lower, problem.system.state.upper),
            np.clip(controls, problem.system.control.lower, problem.system.control.upper),
            np.clip(duration, *problem.duration),
        )

    def schedule(self, state: Tracking) -> Schedule:
        """When the plans end and when to judge, from a recurrent state."""
        return state.schedule

    def predict(
        self,
        observation: ArrayLike,
        state: Tracking | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Tracking]:
        """Controls of one tick, as in Stable-Baselines3.

        Args:
            observation: states and contexts, (B, nx + nc) or (nx + nc,).
            state: what the last call returned, or :meth:`start`; ``None``: all rows start now.
            episode_start: rows to plan anew, from the parameters read off the observation; (B,) or ``None``.
            deterministic: accepted for the protocol; a plan is deterministic.

        Returns:
            Controls (B, nu) or (nu,) in float64, and the recurrent state.
        """
        single = np.ndim(observation) == 1
        x, contexts = _split(self.problem, np.atleast_2d(observation))
        fresh = _flags(episode_start, len(x))
        if state is None:
            state = self.start(self.problem.parameters_of(x, contexts))
        elif len(state.clock) != len(x):
            raise ValueError(f"got {len(x)} observations with the recurrent state of {len(state.clock)} episodes")
        elif fresh.any():
            p = self.problem.parameters_of(x[fresh], contexts[fresh])
            state = state.replaced(fresh, self.start(p))

        rows, tick = np.arange(len(x)), np.minimum(state.clock, state.states.shape[1] - 1)
        error = self.problem.system.difference(x, state.states[rows, tick])
        feedback = (state.gains[rows, tick] @ error[..., None])[..., 0]
        wanted = state.controls[rows, tick] - feedback
        controls = nearest_control(wanted, state.metrics[rows, tick], self.problem.system.control)
        return (controls[0] if single else controls), dataclasses.replace(state, clock=state.clock + 1)


class Stabiliser:
    """Holds the goal from the start, without any plan.

    Args:
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.
    """

    def __init__(
        self, problem: OptimalControlProblem, dt: float = 0.02, weights: TrackingWeights | None = None
    ) -> None:
        self.problem = problem
        self.regulator = Regulator(problem, dt, weights)
        self.dt = self.regulator.dt

    def controls(self, states: Array) -> Array:
        """Controls (B, nu) at ``states`` (B, nx)."""
        problem, regulator = self.problem, self.regulator
        wanted = problem.goal.control - problem.system.difference(states, problem.goal.state) @ regulator.hold.T
        metric = np.broadcast_to(regulator.hold_metric, (len(states), *regulator.hold_metric.shape))
        return nearest_control(wanted, metric, problem.system.control)

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, None]:
        """Controls (B, nu) or (nu,) at observations (B, nx + nc) or (nx + nc,); there is no recurrent state."""
        controls = self.controls(_split(self.problem, np.atleast_2d(observation))[0])
        return (controls[0] if np.ndim(observation) == 1 else controls), None


@dataclass(frozen=True, eq=False)
class Entered:
    """Recurrent state of :class:`Stabilised`: the inner policy's, and which rows have entered the goal ball, (B,)."""

    inner: Any
    entered: NDArray[np.bool_]


class Stabilised:
    """A policy that hands over to the stabiliser when the state first enters the goal ball.

    Args:
        policy: any policy that reads this environment's observations.
        problem: the problem of the environment.
        dt: control period of the environment, seconds.
        weights: weights of the stabiliser; :meth:`TrackingWeights.default` where not given.
    """

    def __init__(
        self,
        policy: Policy,
        problem: OptimalControlProblem,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> None:
        self.policy, self.problem = policy, problem
        self.stabiliser = Stabiliser(problem, dt, weights)
        self.dt = self.stabiliser.dt

    def predict(
        self,
        observation: ArrayLike,
        state: Entered | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Entered]:
        """Controls (B, nu) or (nu,) at observations (B, nx + nc) or (nx + nc,), and the recurrent state."""
        x, _ = _split(self.problem, np.atleast_2d(observation))
        before = np.zeros(len(x), bool) if state is None else state.entered & ~_flags(episode_start, len(x))
        entered = before | (self.problem.goal_error(x) < self.problem.goal.radius)
        controls, inner = self.policy.predict(
            observation, None if state is None else state.inner, episode_start, deterministic
        )
        held = np.where(entered[:, None], self.stabiliser.controls(x), np.atleast_2d(controls))
        return (held[0] if np.ndim(observation) == 1 else held), Entered(inner, entered)
