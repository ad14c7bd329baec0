"""A policy that plans again on the way, from the present state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.checking.candidates import Candidates
from moe_policy.control.observations import split
from moe_policy.control.policy import ModelPolicy
from moe_policy.control.resampling import Resampler
from moe_policy.control.step import ControlStep, Tracking
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.watch import Watched
from moe_policy.control.weights import TrackingWeights
from moe_policy.planners.owner import planned_problem, plans_of
from moe_policy.planners.solver import SolverPlanner
from moe_policy.protocols import Planner, Schedule, State
from moe_policy.replanning.renewal import Decided, Renewal, Renewer
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.guesses import guesses
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.checks import check_number, check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory


@checked
@dataclass(frozen=True, eq=False)
class Renewed(Batch):
    """Recurrent state of :class:`Replanning` for B rows.

    Args:
        tracking: that of the present plans, whose clocks count from their beginning.
        plan: the present plans; a line to the goal where there is none.
        clock: control steps since the episode's beginning, (B,).
        schedule: of the episodes, whose times count from their beginning.
        expected: the states that follow in the model, (B, nx); NaN at the beginning.
        renewals: how often a plan was replaced by a new one, (B,).
        flips: how often it was replaced by one of another solution family after the first control step, (B,).
    """

    tracking: Tracking
    plan: Trajectory
    clock: Ints
    schedule: Schedule
    expected: Array
    renewals: Ints
    flips: Ints

    def later(self, expected: Array) -> Renewed:
        """This state one control step later, when the model says that the states are ``expected`` (B, nx)."""
        following = object.__new__(Renewed)  # nothing else changes, so nothing needs to be checked again
        following.__dict__.update(
            self.__dict__, clock=self.clock + 1, tracking=self.tracking.later(), expected=expected
        )
        return following

    def restarted(self, rows: Bools, new: Renewed) -> Renewed:
        """This state with the ``rows`` of a mask (B,) taken from ``new``, whose batch is those rows."""
        tracking = self.tracking.restarted(rows, new.tracking)
        longest = tracking.states.shape[1]
        return replace(self, tracking=tracking).replaced(rows, replace(new, tracking=new.tracking.padded(longest)))


class Replanning(ModelPolicy):
    """Tracks a plan, and renews it from the whole present state: at fixed times, and at once after a push.

    A new plan is taken where it is better in the model (:mod:`moe_policy.replanning.renewal`), so that the rest of the
    old one is the worst that can happen. After its end a plan is renewed after a push alone. The first plan is renewed
    at once: by the solver, if ``renewal`` has iterations. The evaluation time is that of the last plan.

    Args:
        planner: maps parameters (B, np) to plans, as for :class:`TrackingPolicy`; or a problem, or its id, for which
            the solver plans from random guesses. A planner for ``problem.from_any_state`` plans from all states.
        every: time between renewals, seconds; rounded to a whole number of control steps, at least one.
        renewal: how plans are renewed; ``None`` for the default.
        experts: of a mixture, the number of experts whose plans are tried on the way; 0 where the planner knows only
            the initial conditions.
        problem: what is planned for; by default the ``problem`` of the planner.
        dt: control period of the environment, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.

    Raises:
        TypeError: a planner that cannot be called.
        ValueError: a planner without a ``problem`` where none is given, a duration that is given by the problem, or a
            time that is not positive.
    """

    recurrent = Renewed

    @checked
    def __init__(
        self,
        planner: Planner | ProblemOrId,
        every: float = 0.2,
        renewal: Renewal | None = None,
        *,
        experts: int = 2,
        problem: ProblemOrId | None = None,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> None:
        if isinstance(planner, (str, OptimalControlProblem)):
            planner = SolverPlanner(problem_of(planner))
        self.problem = planned_problem(planner, problem)
        check_whole("experts", experts, 0)
        if self.problem.horizon.fixed:
            raise ValueError(
                f"{self.problem.id}: its duration is given, so that the rest of a plan is no plan; track it with "
                "TrackingPolicy"
            )
        check_number("every", every)
        if not every > 0:
            raise ValueError(f"every: expected a positive number of seconds, got {every}")
        self.planner, self.renewal = planner, Renewal() if renewal is None else renewal
        self._tracker = TrackingPolicy(self.problem, planner, dt, weights)
        self.dt, self._period = self._tracker.dt, max(1, round(every / dt))
        self.every = self._period * self.dt
        own = getattr(planner, "problem", None)
        self._asked = own if isinstance(own, OptimalControlProblem) else self.problem
        candidates = Candidates(planner, experts, problem=self._asked) if experts else None
        self._renewer = Renewer(self.problem, candidates, self.renewal, self.dt, weights)
        self._resampler = Resampler(self.problem, self.dt)
        self._step = ControlStep(self.problem, self._tracker.regulator.substeps)

    @checked
    def start(self, parameters: ArrayLike) -> Renewed:
        """The recurrent state before the first control step, with plans for ``parameters`` (B, np) or (np,) in float64.

        Raises:
            ValueError: parameters of another shape, or plans of another problem's.
        """
        p = self.problem.check_parameters(parameters, extrapolate=True)
        states, contexts = self.problem.start(p)
        plan = plans_of(self.planner, self._asked.parameters_of(states, contexts))
        tracking = self._tracker.follow(plan, contexts)
        if not plan.finite.all():
            rows = ~plan.finite
            windings = np.zeros(int(rows.sum()), np.int64)
            within, turns = self.problem.in_one_turn(p[rows])
            line = guesses(self.problem, within, windings, np.random.default_rng(0), "line").shifted(turns)
            plan = plan.replaced(rows, line)
        schedule, none = tracking.schedule.shifted(np.zeros(len(p))), np.zeros(len(p), np.int64)
        nothing = np.full((len(p), self.problem.system.nx), np.nan)
        return Renewed(tracking, plan, none, schedule, nothing, none, none)

    def schedule(self, state: State) -> Schedule:
        """When the plans of a recurrent ``state`` of this policy or of its ``predict`` end and are evaluated."""
        own: Renewed = state.inner if isinstance(state, Watched) else state
        return own.schedule

    def act(self, observations: NDArray[np.floating], state: Renewed | None, begins: Bools) -> tuple[Array, Renewed]:
        seen = np.ascontiguousarray(observations, dtype=np.float64)
        if state is None:
            state = self.start(self._parameters(seen))
        elif np.count_nonzero(begins) and len(state.clock) == len(seen):
            state = state.restarted(begins, self.start(self._parameters(seen[begins])))
        state = self._renewed(seen, state)
        controls = self._step(seen, state.tracking)
        return controls, state.later(self._expected(*split(self.problem, seen), controls))

    def _parameters(self, observations: Array) -> Array:
        """The parameters (B, np) that are read off ``observations`` (B, nx + nc)."""
        return self.problem.parameters_of(*split(self.problem, observations))

    def _expected(self, states: Array, contexts: Array, controls: Array) -> Array:
        """The states (B, nx) a control step after ``states`` in ``contexts`` (B, nc) under ``controls`` (B, nu)."""
        flow = self.problem.functions.flow(self._tracker.regulator.substeps)
        return np.asarray(flow(states, controls, contexts, np.full((len(states), 1), self.dt))[0])

    def _surprised(self, states: Array, expected: Array) -> Bools:
        """Where the ``states`` (B, nx) are others than those ``expected``, as after a push."""
        apart = np.abs(self.problem.system.difference(states, expected)) / self.problem.system.state.scale
        return np.asarray((apart > self.renewal.surprise).any(axis=1))

    def _renewed(self, seen: Array, state: Renewed) -> Renewed:
        """``state`` with the plans renewed from the observations ``seen`` (B, nx + nc) where it is time."""
        left = state.schedule.plan_end - state.clock * self.dt + self.dt / 2
        due = (state.clock % self._period == 0) | (left < self.renewal.commit + self.dt)
        surprised = self._surprised(seen[:, : self.problem.system.nx], state.expected)
        # After its end a plan is renewed after a push alone; one that was rejected has no end.
        due = (due & ((left > self.dt) | state.schedule.rejected)) | surprised
        if not due.any():
            return state
        rows = np.flatnonzero(due & np.isfinite(seen).all(axis=1))
        states, contexts = split(self.problem, seen[rows])
        rest = self._rest(state[rows], states, contexts)
        new = surprised[rows] | (state.clock[rows] == 0)
        decided = self._renewer(states, contexts, state.tracking[rows].rest(self.dt), rest, new)
        return self._taken(state, rows, decided, contexts)

    def _rest(self, state: Renewed, states: Array, contexts: Array) -> Trajectory:
        """The rest of the plans of ``state``, B of them, in the turn of the present ``states`` (B, nx)."""
        rest = self._resampler.rest(state.plan, contexts, np.asarray(state.tracking.clock * self.dt))
        apart = states - rest.states[:, 0]
        return rest.shifted(apart - self.problem.system.difference(states, rest.states[:, 0]))

    def _taken(self, state: Renewed, rows: Ints, decided: Decided, contexts: Array) -> Renewed:
        """``state`` with the new plans among those ``decided`` for ``rows`` (M,) in ``contexts`` (M, nc)."""
        if not decided.new.any():
            return state
        changed, plan = rows[decided.new], decided.plan[decided.new]
        mask = np.zeros(len(state), bool)
        mask[changed] = True
        tracking = self._tracker.follow(plan, contexts[decided.new])
        schedule = tracking.schedule.shifted(np.asarray(state.clock[changed] * self.dt))
        return replace(
            state,
            tracking=state.tracking.restarted(mask, tracking),
            plan=state.plan.replaced(mask, plan),
            schedule=state.schedule.replaced(mask, schedule),
            renewals=state.renewals + mask,
            flips=state.flips + (mask & (state.clock > 0) & np.isin(np.arange(len(state)), rows[decided.flipped])),
        )

    def __repr__(self) -> str:
        return f"Replanning({self.planner!r}, every={self.every:g}, {self.renewal}, dt={self.dt})"
