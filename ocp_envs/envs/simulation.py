"""One control step, the only function in which the time of an episode passes.

A control step of ``dt`` seconds is the Runge-Kutta map of the problem (:meth:`OptimalControlProblem.flow`) under a
control that is constant and clipped to its box. It returns the next state, the cost ∫L dt of the step, whether the next
state lies in the goal ball ‖x − goal‖ < radius, how far it violates the path constraints, and whether it left the
operating box. :meth:`Simulator.advance` evaluates it on arrays and returns new ones; :class:`ControlStep` evaluates the
same function in place on arrays with names, which the environments do.

All results are finite: a state outside the operating box is clipped into it (a NaN counts as outside and becomes the
lower bound), a NaN control becomes its lower bound, and the cost of a step that left the box is bounded by the largest
cost rate times dt. A cost that is not finite counts as leaving the box, too.

Accuracy at 0.02 s against SciPy's DOP853 (results/benchmark_env.json, written by scripts/benchmark_env.py): in the
middle two thirds of the boxes of state and control, errors are below 2.5e-6. In the whole boxes, that of the vehicle is
below 7e-5; that of the quadcopter, which tumbles at 8 rad/s next to the singularity of its angles, reaches 4e-4 (2e-5
in 99 % of the cases, 8e-7 in the median).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.control_step import runge_kutta_steps
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.batch import BatchFunction, BoundFunction, dense_function
from ocp_envs.support.doors import checked
from ocp_envs.system import Box

_MAX_VERTICES = 2**16


@lru_cache(maxsize=32)
def largest_cost_rate(problem: OptimalControlProblem) -> float:
    """Largest cost rate L of ``problem`` over its boxes of state, control and context, in units of cost per second.

    A convex function attains its maximum over a box at a vertex, so L is evaluated at the vertices spanned by the
    coordinates on which it depends; where there are more than 2^16, at as many drawn at random.
    """
    x, u, s = problem.symbols()
    z = ca.vertcat(x, u, s)
    rate = problem.rate(x, u, s)[problem.system.nx]
    boxes: tuple[Box, ...] = (problem.system.state, problem.system.control, problem.context)
    lower = np.concatenate([box.lower for box in boxes])
    upper = np.concatenate([box.upper for box in boxes])
    active = np.flatnonzero(ca.which_depends(rate, z, 1))
    if 2 ** len(active) <= _MAX_VERTICES:
        choice = np.array(list(itertools.product((False, True), repeat=len(active))), dtype=bool)
    else:
        choice = np.random.default_rng(0).random((_MAX_VERTICES, len(active))) < 0.5
    points = np.tile((lower + upper) / 2, (len(choice), 1))
    points[:, active] = np.where(choice, upper[active], lower[active])
    (values,) = BatchFunction(dense_function("cost_rate", [z], [rate]))(points)
    return float(np.max(values, where=np.isfinite(values), initial=-np.inf))


def _clip(values: ca.SX, box: Box) -> ca.SX:
    """``values`` clipped to ``box``; fmax and fmin return the other argument for a NaN, which gives the lower bound."""
    return ca.fmin(ca.fmax(values, ca.DM(box.lower)), ca.DM(box.upper))


def _violation(problem: OptimalControlProblem, x: ca.SX, u: ca.SX, s: ca.SX, following: ca.SX) -> ca.SX:
    """By how much a step under ``u`` from ``x`` to ``following`` in the context ``s`` violates a path constraint most.

    Those on the state are evaluated at its end, those on state and control at its beginning.
    """
    inequalities, equalities = problem.formulation.mixed(x, _clip(u, problem.system.control), s)
    lacking = ca.vertcat(-problem.clearances(following, s), -inequalities, ca.fabs(equalities))
    return ca.fmax(0, ca.mmax(lacking)) if lacking.numel() else ca.SX(0)


@lru_cache(maxsize=32)
def _step_function(problem: OptimalControlProblem, dt: float, substeps: int, disturbed: bool) -> ca.Function:
    """(x, u, s[, w]) → (next x, [cost, violation, reached, left the box]): one control step."""
    system = problem.system
    x, u, s = problem.symbols()
    w = ca.SX.sym("w", system.nx)
    following, cost = problem.formulation.flow(x, _clip(u, system.control), s, dt, substeps, w if disturbed else 0)
    inside = ca.fabs(cost) < np.inf
    for i, coordinate in enumerate(system.state.coordinates):
        inside = ca.logic_and(inside, ca.logic_and(following[i] >= coordinate.lower, following[i] <= coordinate.upper))
    reached = ca.logic_and(inside, problem.terminal.squared_error(following, s) < problem.goal.radius**2)
    following = _clip(following, system.state)
    violation = _violation(problem, x, u, s, following)
    limit = abs(largest_cost_rate(problem)) * dt
    cost = ca.if_else(inside, cost, ca.fmax(ca.fmin(cost, limit), -limit))
    inputs = [x, u, s, w] if disturbed else [x, u, s]
    summary = ca.vertcat(cost, violation, reached, ca.logic_not(inside))
    return dense_function("control_step", inputs, ca.cse([following, summary]))


@checked
@dataclass(frozen=True, eq=False)
class Step:
    """The result of one control step of B rows.

    Args:
        states: next states, inside the operating box, (B, nx).
        cost: ∫L dt over the step, (B,).
        reached: whether the next state is inside the goal ball, (B,).
        violation: of the path constraints, in their unit, (B,).
        left_box: whether the state left the operating box and was clipped, (B,).
    """

    states: Array
    cost: Array
    reached: Bools
    violation: Array
    left_box: Bools


class ControlStep:
    """One control step of a fixed number of rows, in place, with the ``function`` that a :class:`Simulator` binds.

    Write ``state`` (rows, nx), ``control`` (rows, nu), ``context`` (rows, nc) and, in a step with a disturbance,
    ``disturbance`` (rows, nx), the term added to ẋ; call :attr:`evaluate`; read ``following``, the next state, and
    ``cost``, ``violation``, ``reached`` and ``left_box`` (rows,) as in :class:`Step`, with 0 or 1 for a truth value.
    The arrays belong to the function: replace their values, never them. Copying and pickling carry the values over.
    """

    @checked
    def __init__(self, function: BoundFunction) -> None:
        self._function = function
        self.evaluate = function.__call__
        self.state, self.control, self.context, *more = function.inputs
        self.disturbance: Array = more[0] if more else np.empty((function.size, 0))
        self.following, summary = function.outputs
        self.cost, self.violation, self.reached, self.left_box = summary.T

    def __reduce__(self) -> tuple[type[ControlStep], tuple[BoundFunction]]:
        return ControlStep, (self._function,)


class Simulator:
    """Control steps of a problem, for any number of rows.

    Args:
        problem: what to simulate; ``problem.with_constants(...)`` for a plant that differs from the model.
        dt: length of a control step, s.
        substeps: Runge-Kutta steps within a control step; by default as many as keep each below the problem's
            ``longest_substep``.

    Raises:
        TypeError: a ``dt`` or substeps that are no numbers.
        ValueError: a ``dt`` that is not positive or longer than the longest plan, or other than 1 to
            :data:`~ocp_envs.control_step.MOST_SUBSTEPS` Runge-Kutta steps.
    """

    @checked
    def __init__(self, problem: ProblemOrId, dt: float, substeps: int | None = None) -> None:
        problem = problem_of(problem)
        self.problem = problem
        self.substeps = runge_kutta_steps(problem, dt, substeps)
        self.dt = float(dt)

    @cached_property
    def _plain(self) -> BatchFunction:
        return BatchFunction(_step_function(self.problem, self.dt, self.substeps, False))

    @cached_property
    def _disturbed(self) -> BatchFunction:
        return BatchFunction(_step_function(self.problem, self.dt, self.substeps, True))

    @property
    def step_function(self) -> ca.Function:
        """(x, u, s) → (next x, [cost, violation, reached, left the box]): a control step without a disturbance."""
        return self._plain.function

    @checked
    def advance(
        self, states: ArrayLike, controls: ArrayLike, contexts: ArrayLike, disturbance: ArrayLike | None = None
    ) -> Step:
        """One control step of B rows from ``states`` (B, nx) under ``controls`` (B, nu), clipped to their box.

        ``contexts`` are (B, nc); ``disturbance`` (B, nx) is a term added to ẋ during the step, none by default.

        Raises:
            ValueError: arrays of other shapes.
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

    @checked
    def control_step(self, rows: int, disturbed: bool = False) -> ControlStep:
        """One control step of ``rows`` ≥ 1 rows in place; ``disturbed`` says whether it takes a disturbance."""
        return ControlStep((self._disturbed if disturbed else self._plain).bind(rows))
