"""Why an instance was not solved, in a sentence: what is not finite, or which constraint the best attempt violates."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import residuals
from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction, dense_function
from ocp_envs.trajectory import Trajectory


def not_finite(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory) -> str:
    """Which function of ``problem``, and where, is not finite along ``trajectory``, or the derivative of which.

    The first such place is told, "" where there is none. The trajectories (B) belong to ``parameters`` (B, np); those
    that are not finite are left out.
    """
    _, contexts = problem.start(parameters)
    names, function = _values_and_derivatives(problem)
    for row in np.flatnonzero(trajectory.finite).tolist():
        states = trajectory.states[row]
        controls = np.concatenate([trajectory.controls[row], problem.terminal.controls(contexts[row : row + 1])])
        values = function(states, controls, np.repeat(contexts[row : row + 1], len(states), axis=0))
        for name, value in zip(names, values):
            bad = np.flatnonzero(~np.isfinite(value.reshape(len(states), -1)).all(axis=1))
            if len(bad):
                knot = int(bad[0])
                return (
                    f"{name} is not finite at knot {knot}, state {_text(states[knot])}, control {_text(controls[knot])}"
                )
    return ""


def _values_and_derivatives(problem: OptimalControlProblem) -> tuple[list[str], BatchFunction]:
    x, u, s = problem.symbols()
    rate, nx = problem.rate(x, u, s), problem.system.nx
    terms = {"the derivative of the state": rate[:nx], "the cost rate": rate[nx]}
    if problem.n_clearances:
        terms["a clearance"] = problem.clearances(x, s)
    for name, term in zip(("an inequality", "an equality"), problem.formulation.mixed(x, u, s)):
        if term.numel():
            terms[name] = term
    if problem.terminal_cost is not None:
        terms["the terminal cost"] = problem.formulation.terminal_cost(x, s)
    every = dict(terms)
    for name, term in terms.items():
        every[f"the gradient of {name}"] = ca.jacobian(term, ca.vertcat(x, u))
    return list(every), BatchFunction(dense_function("values", [x, u, s], list(every.values())))


class Violated(NamedTuple):
    """What the best of some attempts, in ``row``, violates most: a ``constraint`` of a ``kind``, and by how much.

    ``kind`` is a key of :func:`~ocp_envs.solvers.check.residuals`, ``knot`` is ``None`` for the duration, and ``unit``
    says in what the ``amount`` is measured, "" for the unit of the constraint.
    """

    row: int
    kind: str
    constraint: str
    knot: int | None
    amount: float
    unit: str

    @property
    def text(self) -> str:
        """In a sentence."""
        where = "" if self.knot is None else f" at knot {self.knot}"
        return f"the best attempt violates {self.constraint} most,{where} by {self.amount:.3g}{self.unit}"


def most_violated(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory) -> Violated | None:
    """Which constraint the best of B attempts ``trajectory`` violates most, where and by how much.

    The best attempt is the one whose largest violation is smallest; those that are not finite are left out, and the
    result is ``None`` without any. All belong to instances of ``problem`` with ``parameters`` (B, np).
    """
    finite = np.flatnonzero(trajectory.finite)
    if not len(finite):
        return None
    found, _ = residuals(problem, parameters[finite], trajectory[finite])
    largest = np.stack([np.nan_to_num(amount, nan=np.inf).max(axis=(1, 2), initial=0.0) for amount in found.values()])
    row = int(largest.max(axis=0).argmin())
    kind, amount = list(found.items())[int(largest[:, row].argmax())]
    knot, i = (int(k) for k in np.unravel_index(amount[row].argmax(), amount[row].shape))
    unit = {"clearance": "", "between": "", "mixed": "", "final": "", "duration": " of the longest one"}.get(
        kind, " of its scale"
    )
    where = None if kind == "duration" else problem.knots - 1 if kind in ("goal", "final") else knot
    return Violated(int(finite[row]), kind, _named(problem, kind, i), where, float(amount[row, knot, i]), unit)


def _named(problem: OptimalControlProblem, kind: str, i: int) -> str:
    """What component ``i`` of the constraints of a ``kind`` is called."""
    state, control = problem.system.state.names, problem.system.control.names
    return {
        "dynamics": lambda: f"the dynamics of {state[i]}",
        "goal": lambda: f"the final {state[i]}",
        "state": lambda: f"the bounds of {state[i]}",
        "control": lambda: f"the bounds of {control[i]}",
        "duration": lambda: "the bounds of the duration",
        "clearance": lambda: f"clearance {i}",
        "between": lambda: f"clearance {i % problem.n_clearances} after",
        "mixed": lambda: f"inequality {i}" if i < problem.n_mixed[0] else f"equality {i - problem.n_mixed[0]}",
        "final": lambda: f"final constraint {i}",
    }[kind]()


def _text(values: Array) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in values) + "]"
