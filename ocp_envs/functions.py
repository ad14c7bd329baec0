"""The functions of a problem on arrays: rows of states x (B, nx), controls u (B, nu) and contexts s (B, nc)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction, Linearisation, dense_function
from ocp_envs.support.doors import checked
from ocp_envs.support.kept import kept

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


class BatchFunctions:
    """The functions of ``problem`` on arrays; each is made once and kept."""

    @checked
    def __init__(self, problem: OptimalControlProblem) -> None:
        self._problem = problem

    @kept
    def rate(self) -> BatchFunction:
        """The function (x, u, s) → (ẋ (B, nx), L (B, 1))."""
        x, u, s = self._problem.symbols()
        rate = self._problem.rate(x, u, s)
        return BatchFunction(
            dense_function("rate", [x, u, s], [rate[: self._problem.system.nx], rate[self._problem.system.nx]])
        )

    @kept
    def flow(self, substeps: int) -> BatchFunction:
        """The function (x, u, s, h (B, 1)) → (x⁺ (B, nx), cost (B, 1)) of steps in ``substeps`` Runge-Kutta steps."""
        (x, u, s), h = self._problem.symbols(), ca.SX.sym("h")
        return BatchFunction(
            dense_function("flow", [x, u, s, h], list(self._problem.formulation.flow(x, u, s, h, substeps)))
        )

    @kept
    def linearisation(self, substeps: int) -> Linearisation:
        """The function (x, u, s, h (B, 1)) → A (B, nx, nx), B (B, nx, nu), derivatives of ``flow(substeps)``."""
        (x, u, s), h = self._problem.symbols(), ca.SX.sym("h")
        following, _ = self._problem.formulation.flow(x, u, s, h, substeps)
        jacobian = ca.jacobian(following, ca.vertcat(x, u))
        return Linearisation(BatchFunction(dense_function("linearisation", [x, u, s, h], [jacobian])))

    @kept
    def mixed(self) -> BatchFunction:
        """The function (x, u, s) → constraints on states and controls, those ≥ 0 (B, ng) and those = 0 (B, ne)."""
        x, u, s = self._problem.symbols()
        return BatchFunction(dense_function("mixed", [x, u, s], list(self._problem.formulation.mixed(x, u, s))))

    @kept
    def between(self) -> BatchFunction:
        """The function (x, u, s, h (B, 1)) → path constraints inside intervals of h seconds, (B, n_between)."""
        (x, u, s), h = self._problem.symbols(), ca.SX.sym("h")
        return BatchFunction(dense_function("between", [x, u, s, h], [self._problem.formulation.between(x, u, s, h)]))

    @kept
    def terminal_cost(self) -> BatchFunction:
        """The function (x, s) → φ (B, 1)."""
        x, _, s = self._problem.symbols()
        return BatchFunction(dense_function("terminal_cost", [x, s], [self._problem.formulation.terminal_cost(x, s)]))

    @kept
    def clearances(self) -> BatchFunction:
        """The function (x, s) → h (B, nh)."""
        x, _, s = self._problem.symbols()
        return BatchFunction(dense_function("clearances", [x, s], [self._problem.clearances(x, s)]))

    @kept
    def durations(self) -> BatchFunction:
        """The function s → the shortest and the longest duration, (B, 2)."""
        _, _, s = self._problem.symbols()
        return BatchFunction(dense_function("durations", [s], [self._problem.formulation.durations(s)]))

    @kept
    def rest(self) -> BatchFunction:
        """The function s → initial values of the state coordinates that p does not name, (B, nx)."""
        _, _, s = self._problem.symbols()
        return BatchFunction(dense_function("rest", [s], [self._problem.formulation.rest(s)]))

    def rest_at(self, contexts: Array) -> Array:
        """The values of :meth:`rest` in ``contexts`` (B, nc), (B, nx)."""
        return np.asarray(self.rest()(contexts)[0])
