"""Instances that no trajectory can solve, recognised by their ends alone.

The initial state is given, and so are the goal states up to the tolerance of the solver. Where one of them lies outside
the state box, or violates a path constraint, nothing needs to be solved.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction, dense_function
from ocp_envs.support.kept import kept

#: Violations up to this one count as none: in scales of a coordinate, and in the unit of a clearance.
TOLERANCE = 1e-6
#: How far a final state may be from the goal, in scales of each coordinate.
GOAL_TOLERANCE = 2e-5


def infeasible_rows(problem: OptimalControlProblem, parameters: Array, goal: bool = True) -> dict[int, str]:
    """The infeasible ones among the instances of ``problem`` with ``parameters`` (B, np), and why, by their row.

    Found are those whose initial state, or whose every goal state if ``goal``, violates a constraint.
    """
    initial, contexts = problem.start(parameters)
    reasons = _outside_box(problem, initial)
    if not problem.n_clearances:
        return reasons
    (clearance,) = problem.functions.clearances()(initial, contexts)
    _add(reasons, clearance, "knot 0, the initial state")
    if goal and problem.terminal.fixed.all():
        targets = np.moveaxis(problem.terminal.nearest(initial, contexts), 1, 0)
        # A final state within the tolerance of the goal may be clear where the goal is not.
        reached = np.array([np.add(*_with_reach(problem)(target, contexts)) for target in targets])
        best = reached.min(axis=2).argmax(axis=0)
        _add(reasons, reached[best, np.arange(len(parameters))], f"knot {problem.knots - 1}, the goal")
    return reasons


def _outside_box(problem: OptimalControlProblem, initial: Array) -> dict[int, str]:
    box, reasons = problem.system.state, {}
    excess = np.maximum(box.lower - initial, initial - box.upper) / box.scale
    for row in np.flatnonzero(excess.max(axis=1) > TOLERANCE).tolist():
        i = int(excess[row].argmax())
        coordinate = box.coordinates[i]
        reasons[row] = (
            f"state {coordinate.name} = {initial[row, i]:g}{_unit(coordinate.unit)} lies outside its box "
            f"[{box.lower[i]:g}, {box.upper[i]:g}] at knot 0, the initial state"
        )
    return reasons


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _add(reasons: dict[int, str], clearance: Array, where: str) -> None:
    """Add the rows of ``clearance`` (B, nh) that are negative."""
    for row in np.flatnonzero(clearance.min(axis=1) < -TOLERANCE).tolist():
        i = int(clearance[row].argmin())
        reasons.setdefault(row, f"clearance {i} is {clearance[row, i]:.6g}, less than 0, at {where}")


@kept
def _with_reach(problem: OptimalControlProblem) -> BatchFunction:
    """The function (x, s) → clearances (B, nh), and how much they may change within the tolerance of the goal."""
    x, _, s = problem.symbols()
    clearances = problem.clearances(x, s)
    step = ca.DM(GOAL_TOLERANCE * problem.system.state.scale)
    reach = ca.mtimes(ca.fabs(ca.jacobian(clearances, x)), step)
    return BatchFunction(dense_function("clearances_and_reach", [x, s], [clearances, reach]))
