"""CasADi's ``Opti`` with IPOPT on a benchmark problem's nonlinear program, as its documentation shows it."""

from __future__ import annotations

import time

import casadi as ca
import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Result, Status, Task
from ocp_envs.solvers.solutions import Solutions, collect, make_tasks
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.trajectory import Trajectory


class PlainOpti:
    """IPOPT on the nonlinear program of this package, its functions as they are or expanded to scalar expressions."""

    def __init__(self, problem: OptimalControlProblem, tolerance: float, expand: bool) -> None:
        self.problem, self.program = problem, transcribe(problem)
        lower, upper = (b for b in self.program.bounds(problem.targets[0]))
        opti = ca.Opti()
        self.w, self.p = opti.variable(len(lower)), opti.parameter(self.program.nlp.numel_in("p"))
        self.lower, self.upper = opti.parameter(len(lower)), opti.parameter(len(upper))
        cost, g = self.program.nlp(self.w, self.p)
        low, high = self.program.constraint_bounds
        opti.minimize(cost)
        opti.subject_to(opti.bounded(self.lower, self.w, self.upper))
        equal = np.flatnonzero(low == high).tolist()
        opti.subject_to(g[equal] == 0)
        if len(equal) < len(low):
            opti.subject_to(g[np.flatnonzero(low != high).tolist()] >= 0)
        opti.solver("ipopt", {"print_time": False, "expand": expand}, {"print_level": 0, "sb": "yes", "tol": tolerance})
        self.opti = opti

    def solve(self, parameters: Array, guess: Trajectory, windings: Ints) -> Solutions:
        """Solve ``parameters`` (B, np) as the solver of this package does, the independent check included."""
        tasks = make_tasks(self.problem, self.program, parameters, guess, windings)
        return collect(self.problem, self.program, parameters, [self._one(task) for task in tasks])

    def _one(self, task: Task) -> Result:
        began, opti = time.perf_counter(), self.opti
        lower, upper = self.program.bounds(self.problem.targets[task.target])
        opti.set_value(self.p, task.parameter)
        opti.set_value(self.lower, lower)
        opti.set_value(self.upper, upper)
        opti.set_initial(self.w, task.guess)
        try:
            opti.solve()
            status = Status.SOLVED
        except RuntimeError:
            status = Status.NOT_CONVERGED
        w, cost = np.array(opti.debug.value(self.w)), float(opti.debug.value(opti.f))
        iterations = int(opti.stats()["iter_count"])
        unused = np.zeros(self.program.clearance_rows.shape)
        return Result(status, w, cost, unused, iterations, False, time.perf_counter() - began)
