"""What is recorded of episodes while they run, one control step after another."""

from __future__ import annotations

import numpy as np

from moe_policy.protocols import Schedule
from moe_policy.rollouts.episodes import Episodes
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.clock import count_steps


class Violations:
    """Violations of the path constraints of ``problem`` in B episodes; zero where it has none.

    Episodes begin at ``states`` (B, nx) in ``contexts`` (B, nc). The attributes ``path`` and ``knots`` (B,) are the
    maxima over the control steps of ``dt`` seconds and over the plan's knots, which are ``knot_step`` (B,) seconds
    apart; ``knot_step`` and ``knots`` are NaN without a plan. ``clearance`` (B,) is the smallest clearance at both,
    +inf without constraints.
    """

    def __init__(
        self, problem: OptimalControlProblem, dt: float, states: Array, contexts: Array, knot_step: Array
    ) -> None:
        self.problem, self.dt, self.contexts, self.knot_step = problem, dt, contexts, knot_step
        self._clearances = problem.functions.clearances() if problem.n_clearances else None
        self.clearance = self._at(states, contexts)
        self.path = np.maximum(0.0, -self.clearance)
        self.knots = np.where(np.isnan(knot_step), np.nan, self.path)

    def _at(self, states: Array, contexts: Array) -> Array:
        """The smallest clearance at ``states`` (B, nx) in ``contexts`` (B, nc), (B,)."""
        if self._clearances is None:
            return np.full(len(states), np.inf)
        return np.asarray(self._clearances(states, contexts)[0].min(axis=1))

    def add(self, step: int, running: Bools, before: Array, after: Array) -> None:
        """Add control step number ``step``, from ``before`` to ``after`` (B, nx), to the ``running`` episodes (B,)."""
        if self._clearances is None:
            return
        clearance = self._at(after, self.contexts)
        self.path[running] = np.maximum(self.path, -clearance)[running]
        self.clearance[running] = np.minimum(self.clearance, clearance)[running]
        # Knots lie between control steps, over which the path is close to its chord. One knot is considered in each
        # control step, so of several knots in one it is the last.
        knot = np.floor(step * self.dt / self.knot_step + 1e-9)
        fraction = knot * self.knot_step / self.dt - (step - 1)
        rows = running & (fraction > 0) & (knot < self.problem.knots)
        if rows.any():
            at_knot = before[rows] + fraction[rows, None] * (after[rows] - before[rows])
            clearance = self._at(at_knot, self.contexts[rows])
            self.knots[rows] = np.maximum(self.knots[rows], -clearance)
            self.clearance[rows] = np.minimum(self.clearance[rows], clearance)


class Ledger:
    """Metrics of B episodes of ``problem`` while they run; the attribute ``running`` (B,) says which still do.

    They begin at ``states`` (B, nx) in ``contexts`` (B, nc) and are evaluated at the time of their ``schedule``, else
    ``problem.hold`` seconds after the first entry, at the latest after ``steps`` control steps of ``dt`` seconds.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        dt: float,
        steps: int,
        states: Array,
        contexts: Array,
        schedule: Schedule | None,
    ) -> None:
        size, unknown = len(states), np.full(len(states), np.nan)
        self.problem, self.dt, self.steps, self.schedule = problem, dt, steps, schedule
        self.running = np.ones(size, bool)
        self.contexts = contexts
        self._error: Array = problem.goal_error(states, contexts)
        self._earliest = np.zeros(size, np.int64)
        if problem.horizon.fixed:
            self._earliest = np.minimum(count_steps(problem.horizon.of(contexts)[:, 1], dt), steps)
        self._success, self._left_box = np.zeros(size, bool), np.zeros(size, bool)
        self._cost = np.zeros(size)
        self._final_error, self._plan_end_error = unknown.copy(), unknown.copy()
        self._entry, self._plan_end, self._evaluation = (np.full(size, step) for step in (-1, -1, steps))
        if schedule is not None:
            self._evaluation, self._plan_end = self._steps_of(schedule)
        knot_step = unknown if schedule is None else schedule.knot_step
        self._violations = Violations(problem, dt, states, contexts, knot_step)
        self._note(0, self._error < problem.goal.radius)

    def _steps_of(self, schedule: Schedule) -> tuple[Ints, Ints]:
        """The control steps of the evaluation and of the plan's end, (B,) each."""
        times = (schedule.evaluation, schedule.plan_end)
        evaluation, plan_end = (np.minimum(count_steps(time, self.dt), self.steps) for time in times)
        return evaluation, plan_end

    def reschedule(self, schedule: Schedule) -> None:
        """Episodes that are running have another ``schedule`` from now on."""
        self.schedule, (evaluation, plan_end) = schedule, self._steps_of(schedule)
        self._evaluation = np.where(self.running, evaluation, self._evaluation)
        self._plan_end = np.where(self.running, plan_end, self._plan_end)

    def add(self, step: int, before: Array, after: Array, cost: Array, left_box: Bools) -> None:
        """Add control step number ``step``, from the states ``before`` to those ``after`` (B, nx).

        ``cost`` (B,) is ∫L dt over it; ``left_box`` (B,) marks the episodes that left the operating box in it.
        """
        running = self.running.copy()
        self._error = self.problem.goal_error(after, self.contexts)
        self._violations.add(step, running, before, after)
        counted = running & (self._entry < 0)
        self._cost[counted] += cost[counted]
        left = running & left_box
        self._left_box |= left
        self._evaluation[left] = step
        self._plan_end[left & (self._plan_end > step)] = step
        self._note(step, (self._error < self.problem.goal.radius) & ~left_box)
        if self.problem.terminal_cost is not None:
            ends = (counted & ~left_box) & ((self._entry == step) | ((self._entry < 0) & (self._evaluation == step)))
            (terminal,) = self.problem.functions.terminal_cost()(after, self.contexts)
            self._cost[ends] += terminal[ends, 0]

    def _note(self, step: int, inside: Bools) -> None:
        """Note what happens at ``step``: the first entry, the plan's end, the evaluation."""
        inside = inside & (step >= self._earliest)
        entered = self.running & inside & (self._entry < 0)
        self._entry[entered] = step
        if self.schedule is None:
            after_hold = step + int(count_steps(self.problem.hold, self.dt))
            self._evaluation[entered] = min(after_hold, self.steps)
        at_end = self.running & (self._plan_end == step)
        self._plan_end_error[at_end] = self._error[at_end]
        due = self.running & (self._evaluation == step)
        self._final_error[due] = self._error[due]
        self._success[due] = inside[due]
        self.running &= ~due

    def episodes(self, parameters: Array) -> Episodes:
        """The episodes with their ``parameters`` (B, np), when none is running any more."""
        none = np.zeros(len(parameters), bool)
        return Episodes(
            parameters=parameters,
            reached=self._entry >= 0,
            success=self._success,
            cost=self._cost,
            entry_time=np.where(self._entry >= 0, self._entry * self.dt, np.nan),
            evaluation_time=self._evaluation * self.dt,
            final_error=self._final_error,
            plan_end_error=self._plan_end_error,
            left_box=self._left_box,
            violation=self._violations.path,
            knot_violation=self._violations.knots,
            clipped=none if self.schedule is None else self.schedule.clipped,
            rejected=none if self.schedule is None else self.schedule.rejected,
        )
