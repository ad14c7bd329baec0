"""A plan seen from the control clock: states and feed-forward controls at the ticks k·dt.

A plan has its own uniform grid, t_i = i·t_f/(N-1), and holds its control between knots. On the control clock:

- the plan takes ⌈t_f/dt⌉ ticks, so the last, partial tick belongs to the plan;
- states at the ticks come from a cubic Hermite polynomial for each interval (Hairer, Nørsett & Wanner, *Solving
  Ordinary Differential Equations I*, II.6), with s ∈ [0, 1] within the interval and slopes m = h ẋ,

      x(s) = (1 + 2s)(1 − s)² x_i + s(1 − s)² m_i + s²(3 − 2s) x_{i+1} + s²(s − 1) m_{i+1},

  where *both* slopes use the interval's own control u_i: the control jumps at knots, so ẋ has two values there;
- the feed-forward on a tick is the time average of the plan's control over it. It is the difference of two values of
  the integral of a step function, hence exact; past t_f the control is the goal's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction
from ocp_envs.support.clock import count_steps
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Reference:
    """A batch of plans on the control clock, padded to the longest with the goal.

    Args:
        states: (B, T+1, nx), x at the ticks 0 … T; from a plan's end on, its final state.
        controls: (B, T, nu), mean control of each tick; from a plan's end on, the goal's control.
        ticks: (B,) number of ticks of each plan, at least 1.
    """

    states: Array
    controls: Array
    ticks: NDArray[np.int64]


def mean_controls(plan: Trajectory, dt: float, ticks: int, after: Array) -> Array:
    """Time averages of the plans' controls over the first ``ticks`` ticks of ``dt`` seconds.

    Args:
        plan: B plans.
        dt: control period, seconds.
        ticks: number of ticks.
        after: control past the end of a plan, (nu,).

    Returns:
        (B, ticks, nu).
    """
    step = plan.step[:, None]
    integral = np.concatenate(
        [np.zeros_like(plan.controls[:, :1]), np.cumsum(plan.controls * step[..., None], axis=1)], axis=1
    )
    held = np.concatenate([plan.controls, np.broadcast_to(after, (len(plan), 1, after.size))], axis=1)
    times = dt * np.arange(ticks + 1)
    interval = np.minimum((times / step).astype(np.int64), plan.knots - 1)
    rows = np.arange(len(plan))[:, None]
    since = times - interval * step
    at_ticks = integral[rows, interval] + since[..., None] * held[rows, interval]
    return np.asarray(np.diff(at_ticks, axis=1) / dt)


def states_at(rate: BatchFunction, plan: Trajectory, contexts: Array, times: Array) -> Array:
    """States of the plans at ``times``, by cubic Hermite interpolation within each interval.

    Args:
        rate: :meth:`OptimalControlProblem.batch_rate` of the problem.
        plan: B plans.
        contexts: (B, nc).
        times: (B, T) or (T,), seconds; times outside [0, t_f] are moved to its ends.

    Returns:
        (B, T, nx).
    """
    size, intervals, nu = plan.controls.shape
    nx = plan.states.shape[2]
    held, context = plan.controls.reshape(-1, nu), np.repeat(contexts, intervals, axis=0)

    def slopes(states: Array) -> Array:
        return rate(states.reshape(-1, nx), held, context)[0].reshape(size, intervals, nx)

    step = plan.step[:, None]
    position = np.clip(times / step, 0.0, intervals)
    interval = np.minimum(position.astype(np.int64), intervals - 1)
    s = (position - interval)[..., None]
    rows = np.arange(size)[:, None]
    left, right = plan.states[rows, interval], plan.states[rows, interval + 1]
    slope_left = slopes(plan.states[:, :-1])[rows, interval] * step[..., None]
    slope_right = slopes(plan.states[:, 1:])[rows, interval] * step[..., None]
    return np.asarray(
        (1 + 2 * s) * (1 - s) ** 2 * left
        + s * (1 - s) ** 2 * slope_left
        + s**2 * (3 - 2 * s) * right
        + s**2 * (s - 1) * slope_right
    )


class Resampler:
    """Puts plans of ``problem`` on a clock of ``dt`` seconds.

    Args:
        problem: the problem the plans belong to.
        dt: control period, seconds.
    """

    def __init__(self, problem: OptimalControlProblem, dt: float) -> None:
        self.problem = problem
        self.dt = dt
        self._rate = problem.batch_rate()

    def __call__(self, plan: Trajectory, contexts: Array) -> Reference:
        """The plans on the control clock.

        Args:
            plan: B plans with finite values and positive durations.
            contexts: (B, nc).
        """
        ticks = count_steps(plan.duration, self.dt)
        longest = int(ticks.max(initial=1))
        times = self.dt * np.arange(longest + 1, dtype=np.float64)
        return Reference(
            states=states_at(self._rate, plan, contexts, times),
            controls=mean_controls(plan, self.dt, longest, self.problem.goal.control),
            ticks=ticks,
        )
