"""Plans resampled at the control steps: states and feed-forward controls at the times k·dt.

A plan has its own uniform grid, t_i = i·t_f/(N-1), and holds its control between knots. At the control steps:

- the plan takes ⌈t_f/dt⌉ of them, so the last, partial one belongs to the plan;
- states come from a cubic Hermite polynomial for each interval (Hairer, Nørsett & Wanner, *Solving
  Ordinary Differential Equations I*, II.6), with s ∈ [0, 1] within the interval and slopes m = h ẋ,

      x(s) = (1 + 2s)(1 − s)² x_i + s(1 − s)² m_i + s²(3 − 2s) x_{i+1} + s²(s − 1) m_{i+1},

  where *both* slopes use the interval's own control u_i: the control is discontinuous at knots, so ẋ has two values
  there;
- the feed-forward of a control step is the time average of the plan's control over it. It is the difference of two
  values of the integral of a step function, hence exact; past t_f the control is the goal's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.batch import BatchFunction
from ocp_envs.support.clock import count_steps
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Resampled(Batch):
    """A batch of plans of ``steps`` (B,) control steps, at least 1, padded to the longest, T.

    ``states`` (B, T+1, nx) are those at the control steps 0 … T, from a plan's end on its final state; ``controls``
    (B, T, nu) are the means over the control steps, from a plan's end on the goal's control.
    """

    states: Array
    controls: Array
    steps: Ints


def mean_controls(plan: Trajectory, dt: float, steps: int, after: Array) -> Array:
    """Time averages of the plans' controls over the first ``steps`` control steps of ``dt`` seconds.

    They are (B, steps, nu) for B plans in ``plan``; past the end of a plan its control is ``after`` (B, nu).
    """
    return np.asarray(np.diff(_integral(plan, np.asarray(dt * np.arange(steps + 1)), after), axis=1) / dt)


def _integral(plan: Trajectory, times: Array, after: Array) -> Array:
    """∫u dt from 0 to ``times`` (B, T) or (T,), seconds, (B, T, nu); past the end of a plan u is ``after`` (B, nu)."""
    step = plan.step[:, None]
    integral = np.concatenate(
        [np.zeros_like(plan.controls[:, :1]), np.cumsum(plan.controls * step[..., None], axis=1)], axis=1
    )
    held = np.concatenate([plan.controls, after[:, None]], axis=1)
    interval = np.minimum((times / step).astype(np.int64), plan.knots - 1)
    rows = np.arange(len(plan))[:, None]
    since = times - interval * step
    return np.asarray(integral[rows, interval] + since[..., None] * held[rows, interval])


def states_at(rate: BatchFunction, plan: Trajectory, contexts: Array, times: Array) -> Array:
    """States (B, T, nx) of the B plans in ``plan`` at ``times`` (B, T) or (T,), seconds, clipped to [0, t_f].

    The slopes are those of ``rate``, a :meth:`BatchFunctions.rate`, in ``contexts`` (B, nc).
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
    """Resamples plans of ``problem`` at control steps of ``dt`` seconds."""

    def __init__(self, problem: OptimalControlProblem, dt: float) -> None:
        self.problem, self.dt = problem, dt

    def __call__(self, plan: Trajectory, contexts: Array) -> Resampled:
        """The B plans in ``plan``, finite and of positive durations, in ``contexts`` (B, nc), at the control steps."""
        steps = count_steps(plan.duration, self.dt)
        longest = int(steps.max(initial=1))
        times = self.dt * np.arange(longest + 1, dtype=np.float64)
        return Resampled(
            states=states_at(self.problem.functions.rate(), plan, contexts, times),
            controls=mean_controls(plan, self.dt, longest, self.problem.terminal.controls(contexts)),
            steps=steps,
        )

    def rest(self, plan: Trajectory, contexts: Array, elapsed: Array) -> Trajectory:
        """The rest of the B plans in ``plan`` after ``elapsed`` (B,) seconds, on as many knots.

        A rest that is shorter than the shortest plan stays at its end. The plans are finite, in ``contexts`` (B, nc).
        """
        duration = np.maximum(plan.duration - elapsed, self.problem.horizon.of(contexts)[:, 0])
        step = (duration / (plan.knots - 1))[:, None]
        times = elapsed[:, None] + step * np.arange(plan.knots)
        integral = _integral(plan, times, self.problem.terminal.controls(contexts))
        states = states_at(self.problem.functions.rate(), plan, contexts, times)
        return Trajectory(states, np.diff(integral, axis=1) / step[..., None], duration)
