"""advance(): the only place where time passes.

One tick of ``dt`` seconds is the Runge-Kutta map of the problem (:meth:`OptimalControlProblem.flow`) under a control
that is held and clipped to its box. A tick gives the next state, the cost ∫L dt over the tick, whether the next state
lies in the goal ball ‖x − goal‖ < radius, how far it violates the path constraints, and whether it left the operating
box.

Nothing non-finite ever leaves: a state outside the operating box is clipped into it (a NaN counts as outside and
becomes the lower bound), a NaN control becomes its lower bound, and the cost of a tick that left the box is bounded by
the largest cost rate times dt. A cost that is not finite counts as leaving, too.

A tick takes as many Runge-Kutta steps as keep each within the problem's ``longest_substep``. Accuracy of a tick of
0.02 s against SciPy's DOP853 (results/benchmark_env.json, made by scripts/benchmark_env.py): over the middle two thirds
of the boxes of state and control the vehicle (one step) and the quadcopter (two) are within 2.5e-6. Over the whole
boxes the vehicle is within 7e-5; the quadcopter, tumbling at 8 rad/s next to the singularity of its angles, is off by
up to 4e-4 (2e-5 in 99 % of the cases, 8e-7 in the median).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction, BoundFunction, dense_function
from ocp_envs.support.clock import count_steps
from ocp_envs.system import Box

_MOST_VERTICES = 2**16


@dataclass(frozen=True, eq=False)
class Step:
    """What one tick of B rows led to.

    Args:
        states: (B, nx), inside the operating box.
        cost: ∫L dt over the tick, (B,).
        reached: inside the goal ball at the end of the tick, (B,).
        violation: max(0, −smallest clearance) at the end of the tick, in the clearance's unit, (B,).
        left_box: the state left the operating box and was clipped, (B,).
    """

    states: Array
    cost: Array
    reached: NDArray[np.bool_]
    violation: Array
    left_box: NDArray[np.bool_]


@lru_cache(maxsize=32)
def largest_cost_rate(problem: OptimalControlProblem) -> float:
    """Largest L over the boxes of state, control and context.

    A convex function attains its maximum over a box at a vertex, so L is evaluated at the vertices spanned by the
    coordinates that it depends on; beyond 2^16 vertices, at as many drawn at random.
    """
    x, u, s = problem.symbols()
    z = ca.vertcat(x, u, s)
    rate = problem.rate(x, u, s)[problem.system.nx]
    boxes: tuple[Box, ...] = (problem.system.state, problem.system.control, problem.context)
    lower = np.concatenate([box.lower for box in boxes])
    upper = np.concatenate([box.upper for box in boxes])
    active = np.flatnonzero(ca.which_depends(rate, z, 1))
    if 2 ** len(active) <= _MOST_VERTICES:
        choice = np.array(list(itertools.product((False, True), repeat=len(active))), dtype=bool)
    else:
        choice = np.random.default_rng(0).random((_MOST_VERTICES, len(active))) < 0.5
    points = np.tile((lower + upper) / 2, (len(choice), 1))
    points[:, active] = np.where(choice, upper[active], lower[active])
    (values,) = BatchFunction(dense_function("cost_rate", [z], [rate]))(points)
    return float(np.max(values, where=np.isfinite(values), initial=-np.inf))


def _clip(values: ca.SX, box: Box) -> ca.SX:
    """Into the box; fmax and fmin return the other argument for a NaN, so that it becomes the lower bound."""
    return ca.fmin(ca.fmax(values, ca.DM(box.lower)), ca.DM(box.upper))


@lru_cache(maxsize=32)
def _tick(problem: OptimalControlProblem, dt: float, substeps: int, disturbed: bool) -> ca.Function:
    """(x, u, s[, w]) → (next x, [cost, violation, reached, left the box]): one tick as one function."""
    system = problem.system
    x, u, s = problem.symbols()
    w = ca.SX.sym("w", system.nx)
    following, cost = problem.flow(x, _clip(u, system.control), s, dt, substeps, w if disturbed else 0)
    inside = ca.fabs(cost) < np.inf
    for i, coordinate in enumerate(system.state.coordinates):
        inside = ca.logic_and(inside, ca.logic_and(following[i] >= coordinate.lower, following[i] <= coordinate.upper))
    reached = ca.logic_and(
        inside, ca.sumsqr(system.difference(following, ca.SX(problem.goal.state))) < problem.goal.radius**2
    )
    following = _clip(following, system.state)
    clearances = problem.clearances(following, s)
    violation = ca.fmax(0, -ca.mmin(clearances)) if problem.n_clearances else ca.SX(0)
    most = abs(largest_cost_rate(problem)) * dt
    cost = ca.if_else(inside, cost, ca.fmax(ca.fmin(cost, most), -most))
    inputs = [x, u, s, w] if disturbed else [x, u, s]
    summary = ca.vertcat(cost, violation, reached, ca.logic_not(inside))
    return dense_function("tick", inputs, ca.cse([following, summary]))


class Simulator:
    """Time steps of a problem, for any number of rows.

    Args:
        problem: what to simulate; ``problem.with_constants(...)`` for a mismatch.
        dt: length of a tick in seconds.
        substeps: Runge-Kutta steps within a tick; by default as many as keep each below the problem's
            ``longest_substep``.

    Raises:
        ValueError: a ``dt`` that is not positive and finite, or fewer than one substep.
    """

    def __init__(self, problem: OptimalControlProblem, dt: float, substeps: int | None = None) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise ValueError(f"{problem.id}: dt must be a positive number of seconds, got {dt}")
        if substeps is not None and substeps < 1:
            raise ValueError(f"{problem.id}: expected at least one substep, got {substeps}")
        self.problem = problem
        self.dt = float(dt)
        self.substeps = substeps or max(1, int(count_steps(dt, problem.longest_substep)))

    @cached_property
    def _plain(self) -> BatchFunction:
        return BatchFunction(_tick(self.problem, self.dt, self.substeps, False))

    @cached_property
    def _disturbed(self) -> BatchFunction:
        return BatchFunction(_tick(self.problem, self.dt, self.substeps, True))

    def advance(
        self, states: ArrayLike, controls: ArrayLike, contexts: ArrayLike, disturbance: ArrayLike | None = None
    ) -> Step:
        """One tick.

        Args:
            states: (B, nx).
            controls: (B, nu), clipped to their box.
            contexts: (B, nc).
            disturbance: added to ẋ over the whole tick, (B, nx).

        Raises:
            ValueError: shapes that do not belong together.
        """
        system = self.problem.system
        sizes = {"states": system.nx, "controls": system.nu, "contexts": len(self.problem.context)}
        arrays = [np.asarray(a, dtype=np.float64) for a in (states, controls, contexts)]
        if disturbance is not None:
            sizes["disturbance"] = system.nx
            arrays.append(np.asarray(disturbance, dtype=np.float64))
        rows = arrays[0].shape[0] if arrays[0].ndim else 0
        for (name, columns), array in zip(sizes.items(), arrays):
            if array.shape != (rows, columns):
                raise ValueError(f"{self.problem.id}: expected {name} of shape ({rows}, {columns}), got {array.shape}")
        function = self._plain if disturbance is None else self._disturbed
        following, summary = function(*arrays)
        cost, violation, reached, left_box = np.ascontiguousarray(summary.T)
        return Step(following, cost, reached > 0, violation, left_box > 0)

    def bind(self, rows: int, disturbed: bool = False) -> BoundFunction:
        """The tick in place on a fixed number of rows, for the environments.

        ``inputs`` are states, controls, contexts and, if ``disturbed``, the disturbance; ``outputs`` are the next
        states and a summary (rows, 4) of cost, violation, reached and left the box (0 or 1).
        """
        return (self._disturbed if disturbed else self._plain).bind(rows)
