"""Accuracy of plans against the true differential equation ẋ = f(x, u, c).

The transcription replaces f by Runge-Kutta steps, so a plan deviates slightly from the true equation. Here SciPy's
DOP853 (Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, II.5) integrates f with the plan's
controls constant over each interval: *per interval*, from each knot to the next, and *open loop*, from x_0 to t_f. Rows
are integrated together in τ = t/h ∈ [0, 1], dx/dτ = h f. DOP853 bounds the root mean square over all rows; tolerances
divided by √rows keep each row within :data:`RTOL` and :data:`ATOL`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction
from ocp_envs.trajectory import Trajectory

#: Of each row alone; see the module.
RTOL, ATOL = 1e-10, 1e-12


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of B plans for ``problem`` against the true equation; NaN where it cannot be integrated.

    ``interval`` (B, N − 1, nx) is the true state at the end of every interval, from the stored knot before it, minus
    the stored one; ``open_loop`` (B, nx) is the true state at t_f, from x_0, minus the stored one, and ``goal`` (B,)
    the distance of the former from the goal.
    """

    problem: OptimalControlProblem
    interval: Array
    open_loop: Array
    goal: Array

    def errors(self, kind: str, scaled: bool) -> Array:
        """Norms of the finite errors of a ``kind``, "interval" or "open_loop", in state units or in ``scaled`` ones."""
        error = getattr(self, kind) / (self.problem.system.state.scale if scaled else 1.0)
        norm = np.linalg.norm(error, axis=-1).ravel()
        return np.asarray(norm[np.isfinite(norm)])

    def record(self) -> dict[str, object]:
        """As JSON."""
        return {
            "cases": len(self.goal),
            "not_integrable": int((~np.isfinite(self.goal)).sum()),
            "end_in_the_goal_ball": int((self.goal < self.problem.goal.radius).sum()),
            **{
                kind: {unit: _spread(self.errors(kind, unit == "scaled")) for unit in ("state_units", "scaled")}
                for kind in ("interval", "open_loop")
            },
        }


def integrate(rate: BatchFunction, x: Array, u: Array, s: Array, h: Array) -> Array:
    """True final states (R, nx); NaN in a row that cannot be integrated, for instance as it escapes to infinity.

    The motions under ``rate`` (:meth:`~ocp_envs.problem.BatchFunctions.rate`) begin at ``x`` (R, nx) and
    last ``h`` (R,) seconds, with constant controls ``u`` (R, nu) and contexts ``s`` (R, nc).
    """
    rows, shape = len(x), x.shape
    finite = np.isfinite(x).all(axis=1)
    if not finite.all():
        result = np.full(shape, np.nan)
        if finite.any():
            result[finite] = integrate(rate, *(values[finite] for values in (x, u, s, h)))
        return result

    def derivative(tau: float, y: Array) -> Array:
        return np.asarray((h[:, None] * rate(y.reshape(shape), u, s)[0]).ravel())

    tolerances = {"rtol": RTOL / np.sqrt(rows), "atol": ATOL / np.sqrt(rows)}
    with np.errstate(all="ignore"):  # what is not finite shows in the result
        solution = solve_ivp(derivative, (0.0, 1.0), x.ravel(), method="DOP853", t_eval=[1.0], **tolerances)
    if solution.success:
        return np.asarray(solution.y[:, -1].reshape(shape))
    if rows == 1:
        return np.full(shape, np.nan)
    halves = slice(0, rows // 2), slice(rows // 2, rows)
    return np.concatenate([integrate(rate, x[half], u[half], s[half], h[half]) for half in halves])


def accuracy(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory) -> Accuracy:
    """Errors of B ≥ 1 plans ``trajectory`` for ``problem`` with ``parameters`` (B, np) against the true equation."""
    size, intervals, nu = trajectory.controls.shape
    nx, rate = problem.system.nx, problem.functions.rate()
    initial, contexts = problem.start(parameters)
    ends = integrate(
        rate,
        trajectory.states[:, :-1].reshape(-1, nx),
        trajectory.controls.reshape(-1, nu),
        np.repeat(contexts, intervals, axis=0),
        np.repeat(trajectory.step, intervals),
    )
    x = initial
    for k in range(intervals):
        x = integrate(rate, x, trajectory.controls[:, k], contexts, trajectory.step)
    interval = ends.reshape(size, intervals, nx) - trajectory.states[:, 1:]
    return Accuracy(problem, interval, x - trajectory.states[:, -1], problem.goal_error(x))


def _spread(errors: Array) -> Mapping[str, float] | None:
    """Median, 95th percentile and maximum; ``None`` without any."""
    if not len(errors):
        return None
    median, high, largest = np.quantile(errors, [0.5, 0.95, 1.0]).tolist()
    return {"median": median, "95_percent": high, "largest": largest}
