"""Plans made ready for tracking: in C where there is a compiler, else with NumPy for all plans at once.

A plan is clipped to the boxes and resampled (:mod:`moe_policy.control.resampling`), and gains are computed along it
(:mod:`moe_policy.control.lqr`). From its last control step on stand the goal and what holds there. Of one plan, NumPy
takes twenty microseconds for each control step, a hundred times as long as the program ``follow.c``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from moe_policy.control.lqr import Regulator
from moe_policy.control.program import Program, compiled
from moe_policy.control.resampling import Resampler
from moe_policy.control.step import Tracking, box_arrays, padded
from moe_policy.protocols import Schedule
from ocp_envs.support.arrays import Array, Bools, address, pointers
from ocp_envs.support.clock import TOLERANCE, count_steps
from ocp_envs.trajectory import Trajectory

#: A duration may lie outside its bounds by this fraction of the longest one, from rounding.
ROUNDING = 1e-6


def numbers_of(regulator: Regulator) -> Array:
    """The numbers of a ``regulator`` that ``follow.c`` enumerates."""
    margin = ROUNDING * regulator.problem.horizon.longest
    return np.array([regulator.dt, margin, TOLERANCE, regulator.weights.authority])


class Following:
    """Makes plans ready for tracking with a ``regulator``."""

    def __init__(self, regulator: Regulator) -> None:
        self.regulator, self.problem, self.dt = regulator, regulator.problem, regulator.dt
        self._resample = Resampler(self.problem, self.dt)
        box, weights = self.problem.system.state, regulator.weights
        arrays = (*box_arrays(self.problem), box.lower, box.upper, weights.state, weights.control)
        self._arrays = [np.ascontiguousarray(each) for each in (*arrays, numbers_of(regulator))]
        self._regulation = pointers(self._arrays)

    def __reduce__(self) -> tuple[object, ...]:
        return Following, (self.regulator,)

    @cached_property
    def _program(self) -> Program | None:
        return compiled(self.problem, self.regulator.substeps)

    def __call__(self, plan: Trajectory, contexts: Array) -> Tracking:
        """The recurrent state before the first control step of the B plans in ``plan``, in ``contexts`` (B, nc).

        Raises:
            ValueError: another number of plans, or plans of another problem's.
        """
        problem = self.problem
        expected = (len(contexts), problem.system.nx, problem.system.nu)
        got = (len(plan.duration), plan.states.shape[2], plan.controls.shape[2])
        if got != expected:
            wanted = f"{expected[0]} plans of {expected[1]} states and {expected[2]} controls"
            raise ValueError(f"{problem.id}: the planner must return {wanted}, got {got[0]} of {got[1]} and {got[2]}")
        if self._program is None:
            return self._with_numpy(plan, contexts)
        return self._in_c(self._program, plan, contexts)

    def _in_c(self, program: Program, plan: Trajectory, contexts: Array) -> Tracking:
        problem, size = self.problem, len(contexts)
        nx, nu, terminal, held = (
            problem.system.nx,
            problem.system.nu,
            problem.terminal,
            self.regulator.at_goal(contexts),
        )
        bounds = problem.horizon.of(contexts)
        shortest, longest = bounds.T
        duration = np.where(np.isfinite(plan.duration), np.clip(plan.duration, shortest, longest), shortest)
        length = int(count_steps(duration, self.dt).max(initial=1)) + 1
        # Named, so that they live until the program returns.
        goals = (bounds, terminal.states(contexts), terminal.controls(contexts), *held)
        goal_arrays = [np.ascontiguousarray(each, dtype=np.float64) for each in goals]
        inputs = [np.ascontiguousarray(each) for each in (plan.states, plan.controls, plan.duration, contexts)]
        tracked = [np.empty((size, length, *shape)) for shape in ((nx,), (nu,), (nu, nx), (nu, nu))]
        steps, clipped, rejected = np.empty((3, size), np.int64)
        program.follow(
            size,
            length,
            plan.knots,
            self._regulation,
            pointers(goal_arrays),
            *map(address, inputs),
            pointers(tracked),
            *map(address, (steps, clipped, rejected)),
        )
        knot_step = duration / (plan.knots - 1)
        return self._scheduled(tracked, np.asarray(steps * self.dt), knot_step, clipped > 0, rejected > 0)

    def _with_numpy(self, plan: Trajectory, contexts: Array) -> Tracking:
        problem, rejected = self.problem, ~plan.finite
        margin, (shortest, longest) = ROUNDING * problem.horizon.longest, problem.horizon.of(contexts).T
        clipped = ~rejected & ((plan.duration < shortest - margin) | (plan.duration > longest + margin))
        plan = self._into_boxes(plan, contexts, rejected)
        reference = self._resample(plan, contexts)
        # Between wild knots the interpolation overshoots, out of the box and into singularities of the dynamics.
        box = problem.system.state
        states = np.clip(reference.states, box.lower, box.upper)
        gains, norms = self.regulator.along(states, reference.controls, contexts, reference.steps)
        rejected |= ~np.isfinite(gains).all(axis=(1, 2, 3))
        steps = np.where(rejected, 0, reference.steps)

        after = np.arange(gains.shape[1]) >= steps[:, None]
        controls = padded(reference.controls, gains.shape[1])
        ends, held = problem.terminal.states(contexts), problem.terminal.controls(contexts)
        states, controls = (
            np.where(after[..., None], ends[:, None], states),
            np.where(after[..., None], held[:, None], controls),
        )
        if rejected.any():
            at_goal = self.regulator.at_goal(contexts[rejected])
            gains[rejected], norms[rejected] = at_goal.gain[:, None], at_goal.norm[:, None]
        clipped &= ~rejected
        return self._scheduled([states, controls, gains, norms], steps * self.dt, plan.step, clipped, rejected)

    def _into_boxes(self, plan: Trajectory, contexts: Array, rejected: Bools) -> Trajectory:
        """The plans clipped to the boxes of the problem; rejected ones replaced by the shortest stay at the goal."""
        problem, terminal = self.problem, self.problem.terminal
        row, (shortest, longest) = rejected[:, None, None], problem.horizon.of(contexts).T
        states = np.where(row, terminal.states(contexts)[:, None], plan.states)
        controls = np.where(row, terminal.controls(contexts)[:, None], plan.controls)
        duration = np.where(rejected, shortest, plan.duration)
        return Trajectory(
            np.clip(states, problem.system.state.lower, problem.system.state.upper),
            np.clip(controls, problem.system.control.lower, problem.system.control.upper),
            np.clip(duration, shortest, longest),
        )

    def _scheduled(
        self, tracked: Sequence[Array], plan_end: Array, knot_step: Array, clipped: Bools, rejected: Bools
    ) -> Tracking:
        """The recurrent state with references, feed-forward, gains and norms ``tracked``, before the first step."""
        step = np.where(rejected, np.nan, knot_step)
        schedule = Schedule(plan_end, plan_end + self.problem.hold, step, clipped, rejected)
        states, controls, gains, norms = tracked
        return Tracking(states, controls, gains, norms, np.zeros(len(plan_end), np.int64), schedule)
