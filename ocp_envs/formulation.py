"""The functions of a problem as CasADi expressions in columns x (nx, 1), u (nu, 1) and s (nc, 1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca

from ocp_envs.expressions import Names, called, column, scalar
from ocp_envs.support.doors import checked
from ocp_envs.system import Expression, rk4_step

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


class Formulation:
    """The functions of ``problem``. Those that fail, or return something else, raise a ``ValueError``."""

    @checked
    def __init__(self, problem: OptimalControlProblem) -> None:
        self._problem = problem
        self._read: set[str] = set()

    @property
    def constants_read(self) -> frozenset[str]:
        """The names of the constants that functions of the declaration have read so far."""
        return frozenset(self._read)

    def namespaces(self, s: Expression) -> tuple[Names, Names, dict[str, Expression]]:
        """Context and constants of a column ``s`` (nc, 1) by name, and those of the context that replace constants."""
        problem = self._problem
        context = dict(zip(problem.context.names, ca.vertsplit(s))) if len(problem.context) else {}
        replaced = {name: value for name, value in context.items() if name in problem.system.constants}
        constants = Names("constant", {**problem.system.constants, **replaced}, self._read)
        return Names("context coordinate", context), constants, replaced

    def rate(self, x: Expression, u: Expression, s: Expression) -> Expression:
        """(ẋ, L) as one expression, (nx + 1, 1), in columns ``x``, ``u`` and ``s``."""
        context, constants, _ = self.namespaces(s)
        return self.rate_of(x, u, context, constants)

    def rate_of(self, x: Expression, u: Expression, context: Names, constants: Names) -> Expression:
        """(ẋ, L) of ``x`` and ``u`` as :meth:`rate`, with ``context`` and ``constants`` by name."""
        problem = self._problem
        cost: Any = 0
        if problem.cost_rate is not None:
            what, signature = f"{problem.id}: cost_rate", "state, control, context, constants"
            arguments = ca.vertsplit(x), ca.vertsplit(u), context, constants
            cost = scalar(what, called(what, signature, problem.cost_rate, *arguments))
        return ca.vertcat(problem.system.derivative_of(x, u, constants), cost)

    def flow(
        self, x: Expression, u: Expression, s: Expression, h: Expression, substeps: int, disturbance: Expression = 0
    ) -> tuple[Expression, Expression]:
        """The state after ``h`` seconds and the cost of the step: the Runge-Kutta map of simulator and solver.

        Args:
            x, u, s: columns of state, control and context; the control is constant over the step.
            h: seconds.
            substeps: number of equal Runge-Kutta steps.
            disturbance: (nx, 1), added to ẋ.
        """
        nx = self._problem.system.nx

        def derivative(y: Expression) -> Expression:
            rate = self.rate(y[:nx], u, s)
            return rate + ca.vertcat(disturbance, 0) if not isinstance(disturbance, int) else rate

        y = rk4_step(derivative, ca.vertcat(x, 0), h, substeps)
        return y[:nx], y[nx]

    def clearances(self, x: Expression, s: Expression) -> Expression:
        """h, (nh, 1), in columns ``x`` and ``s``; empty without path constraints."""
        context, constants, _ = self.namespaces(s)
        return self.clearances_of(x, context, constants)

    def clearances_of(self, x: Expression, context: Names, constants: Names) -> Expression:
        """h of ``x`` as :meth:`clearances`, with ``context`` and ``constants`` by name."""
        signature = "state, context, constants"
        return self._column("clearance", self._problem.clearance, signature, x, (ca.vertsplit(x), context, constants))

    def between(self, x: Expression, u: Expression, s: Expression, h: Expression) -> Expression:
        """The path constraints inside an interval of ``h`` seconds, (nh · (points − 1), 1), in the context ``s``.

        It begins at ``x`` and has the control ``u``.

        The points are those of ``problem.clearance_points``, each reached from the knot by Runge-Kutta steps of about
        the length that the interval has.
        """
        problem, found = self._problem, []
        for j in range(1, problem.clearance_points):
            fraction = j / problem.clearance_points
            state, _ = self.flow(x, u, s, fraction * h, math.ceil(problem.substeps * fraction))
            found.append(self.clearances(state, s))
        return ca.vertcat(type(x)(0, 1), *found)

    def mixed(self, x: Expression, u: Expression, s: Expression) -> tuple[Expression, Expression]:
        """The constraints on states and controls, those ≥ 0 and those = 0, in columns ``x``, ``u`` and ``s``."""
        context, constants, _ = self.namespaces(s)
        return self.mixed_of(x, u, context, constants)

    def mixed_of(self, x: Expression, u: Expression, context: Names, constants: Names) -> tuple[Expression, Expression]:
        """As :meth:`mixed` of ``x`` and ``u``, with ``context`` and ``constants`` by name."""
        problem, signature = self._problem, "state, control, context, constants"
        arguments = ca.vertsplit(x), ca.vertsplit(u), context, constants
        return (
            self._column("inequalities", problem.inequalities, signature, x, arguments),
            self._column("equalities", problem.equalities, signature, x, arguments),
        )

    def _column(
        self, name: str, function: Callable[..., Sequence[Any]] | None, signature: str, x: Expression, arguments: Any
    ) -> Expression:
        if function is None:
            return type(x)(0, 1)
        what = f"{self._problem.id}: {name}"
        return column(what, called(what, signature, function, *arguments))

    def terminal_cost(self, x: Expression, s: Expression) -> Expression:
        """φ, one expression in columns ``x`` and ``s``; 0 without a terminal cost."""
        context, constants, _ = self.namespaces(s)
        return self.terminal_cost_of(x, context, constants)

    def terminal_cost_of(self, x: Expression, context: Names, constants: Names) -> Expression:
        """φ of ``x`` as :meth:`terminal_cost`, with ``context`` and ``constants`` by name."""
        problem = self._problem
        if problem.terminal_cost is None:
            return type(x)(0)
        what, signature = f"{problem.id}: terminal_cost", "state, context, constants"
        return scalar(what, called(what, signature, problem.terminal_cost, ca.vertsplit(x), context, constants))

    def durations(self, s: Expression) -> Expression:
        """The shortest and the longest duration, (2, 1), in ``s``."""
        problem = self._problem
        context, constants, _ = self.namespaces(s)
        what = f"{problem.id}: duration"
        bounds = [
            scalar(what, called(what, "context, constants", bound, context, constants)) if callable(bound) else bound
            for bound in problem.duration
        ]
        return ca.vertcat(*bounds)

    def rest(self, s: Expression) -> Expression:
        """Initial values of the state coordinates that p does not name, (nx, 1), in ``s``."""
        problem = self._problem
        context, constants, _ = self.namespaces(s)
        what, rest = f"{problem.id}: rest", problem.rest
        assert callable(rest)
        return column(what, called(what, "context, constants", rest, context, constants), problem.system.state.names)
