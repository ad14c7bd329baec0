"""The recurrent state of tracking, and its control step: in C where there is a compiler, else with NumPy.

Of one row, NumPy takes forty microseconds for a control step; the program ``step.c`` and its call take four.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from moe_policy.control.observations import split
from moe_policy.control.program import Program, compiled
from moe_policy.control.projection import project
from moe_policy.protocols import Schedule
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints, address, pointers
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch

_ONE = np.array(1)  # added in half the time of a number of Python


@checked
@dataclass(frozen=True, eq=False)
class Tracking(Batch):
    """Recurrent state of :class:`TrackingPolicy` for B rows: references, gains and norms at the control steps.

    From a plan's last control step on, rows are those of terminal regulation.

    Args:
        states: references, (B, T+1, nx).
        controls: feed-forward, (B, T+1, nu).
        gains: (B, T+1, nu, nx).
        norms: H, in which controls are projected onto their bounds, (B, T+1, nu, nu).
        clock: control steps since each plan's start, (B,).
        schedule: see :class:`~moe_policy.protocols.Schedule`.

    Raises:
        ValueError: arrays that do not fit together, or a negative clock.
    """

    states: Array
    controls: Array
    gains: Array
    norms: Array
    clock: Ints
    schedule: Schedule

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("states", "controls", "gains", "norms"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        object.__setattr__(self, "clock", np.ascontiguousarray(self.clock, dtype=np.int64))
        (size, length, nx), nu = np.shape(self.states), np.shape(self.controls)[-1]
        shapes = [each.shape for each in (self.states, self.controls, self.gains, self.norms, self.clock)]
        leading = (size, length)
        expected = [(*leading, nx), (*leading, nu), (*leading, nu, nx), (*leading, nu, nu), (size,)]
        if shapes != expected or length == 0:
            raise ValueError(f"Tracking: expected arrays of shapes {expected} with T ≥ 0, got {shapes}")
        if (self.clock < 0).any():
            raise ValueError(f"Tracking: expected clocks of at least 0, got {self.clock.min()}")

    def __reduce__(self) -> tuple[object, ...]:
        fields = (self.states, self.controls, self.gains, self.norms, self.clock, self.schedule)
        return Tracking, fields  # without pointers, which a copy must not have

    @cached_property
    def pointers(self) -> ctypes.Array[ctypes.c_void_p]:
        """References, feed-forward, gains and norms as the compiled program sees them."""
        return pointers([self.states, self.controls, self.gains, self.norms])

    def later(self) -> Tracking:
        """This state one control step later."""
        following = object.__new__(Tracking)  # nothing else changes, so nothing needs to be checked again
        following.__dict__.update(self.__dict__, clock=self.clock + _ONE)
        return following

    def rest(self, dt: float) -> Tracking:
        """This state without its past: the next control step, of ``dt`` seconds, is the first, and times count from it.

        Of the plan's knots nothing is known any more.
        """
        last = self.states.shape[1] - 1
        steps = np.minimum(self.clock[:, None] + np.arange(max(1, last + 1 - int(self.clock.min(initial=0)))), last)
        rows = np.arange(len(steps))[:, None]
        states, controls, gains, norms = (
            each[rows, steps] for each in (self.states, self.controls, self.gains, self.norms)
        )
        schedule = self.schedule.shifted(np.asarray(-dt * self.clock))
        return Tracking(states, controls, gains, norms, np.zeros_like(self.clock), schedule)

    def padded(self, length: int) -> Tracking:
        """This state with ``length`` control steps, the last one repeated."""
        states, controls, gains, norms = (
            padded(values, length) for values in (self.states, self.controls, self.gains, self.norms)
        )
        return replace(self, states=states, controls=controls, gains=gains, norms=norms)

    def restarted(self, rows: Bools, new: Tracking) -> Tracking:
        """This state with the ``rows`` of a mask (B,) taken from ``new``, whose batch is those rows."""
        longest = max(self.states.shape[1], new.states.shape[1])
        return self.padded(longest).replaced(rows, new.padded(longest))


def padded(values: Array, length: int) -> Array:
    """``values`` (B, T, …) with the last of axis 1 repeated up to ``length``."""
    return np.concatenate([values, np.repeat(values[:, -1:], length - values.shape[1], axis=1)], axis=1)


class ControlStep:
    """The controls of tracking for ``problem``, whose control steps are ``substeps`` Runge-Kutta steps."""

    def __init__(self, problem: OptimalControlProblem, substeps: int) -> None:
        self.problem, self.substeps = problem, substeps
        system = problem.system
        self._observed, self._planned = (system.nx + len(problem.context),), (system.nu, system.nx)
        self._boxes = [np.ascontiguousarray(each) for each in box_arrays(problem)]
        self._limits = pointers(self._boxes)

    def __reduce__(self) -> tuple[object, ...]:
        return ControlStep, (self.problem, self.substeps)

    @cached_property
    def _program(self) -> Program | None:
        return compiled(self.problem, self.substeps)

    def __call__(self, observations: Array, tracking: Tracking) -> Array:
        """Controls (B, nu) at contiguous ``observations`` (B, nx + nc), with the recurrent state ``tracking``.

        Raises:
            ValueError: observations or a recurrent state of another problem, or of different numbers of rows.
        """
        gains, clock = tracking.gains, tracking.clock
        if observations.shape != clock.shape + self._observed or gains.shape[2:] != self._planned:
            state = f"a recurrent state of {len(clock)} episodes with gains {gains.shape[2:]}"
            raise ValueError(
                f"{self.problem.id}: expected observations (B, {self._observed[0]}) with gains {self._planned} of as "
                f"many episodes, got observations {observations.shape} with {state}"
            )
        if self._program is None:
            return self._with_numpy(observations, tracking)
        size, length = gains.shape[:2]
        controls = np.empty((size, self._planned[0]))
        self._program.act(
            size,
            length,
            address(clock),
            address(observations),
            self._limits,
            tracking.pointers,
            address(controls),
        )
        return controls

    def _with_numpy(self, observations: Array, tracking: Tracking) -> Array:
        x, _ = split(self.problem, observations)
        rows, step = np.arange(len(x)), np.minimum(tracking.clock, tracking.states.shape[1] - 1)
        error = self.problem.system.difference(x, tracking.states[rows, step])
        feedback = (tracking.gains[rows, step] @ error[..., None])[..., 0]
        return project(
            tracking.controls[rows, step] - feedback, tracking.norms[rows, step], self.problem.system.control
        )


def box_arrays(problem: OptimalControlProblem) -> tuple[Array, Array, Array]:
    """Periods of the state of ``problem``, and lower and upper bounds of its controls, as ``step.c`` needs them."""
    system = problem.system
    return system.state.periods, system.control.lower, system.control.upper
