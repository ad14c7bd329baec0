"""What solves a transcribed program: CasADi's plugins fatrop and IPOPT, and what all solvers do."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from ocp_envs.solvers.compilation import build_solver
from ocp_envs.solvers.nlp import Outcome, SolverSettings, Status, Task
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Array

#: What IPOPT calls two ways of ending.
_IPOPT_INFEASIBLE, _IPOPT_NOT_FINITE = "Infeasible_Problem_Detected", "Invalid_Number_Detected"


class Again(NamedTuple):
    """A further attempt with another ``duration``, a fraction of the longest one.

    It begins where the attempt before it ended, or ``from_guess``, from the guess of the task.
    """

    duration: float
    from_guess: bool


class Backend(Protocol):
    """A solver of one program: its last point ``w`` (nw,), ``cost`` (1,), scaled, and multipliers ``lam_g`` (ng,).

    They are overwritten by every run. Where a run is stuck, the attempts ``again`` follow.
    """

    w: Array
    cost: Array
    lam_g: Array

    @property
    def again(self) -> tuple[Again, ...]:
        """Further attempts."""

    def run(self, task: Task, lower: Array, upper: Array) -> tuple[Outcome, int]:
        """Solve ``task`` with bounds ``lower`` and ``upper`` (nw,) of w: how it ended, and the number of iterations."""

    def status(self, outcome: Outcome) -> Status:
        """The status of a solve that ended with the ``outcome`` of the last run."""


def primary_plugin(program: Transcription, plugin: str, settings: SolverSettings, iterations: int) -> Plugin:
    """The ``plugin`` "fatrop" or "ipopt" with compiled functions of the ``program``, with a limit of ``iterations``.

    The tolerance is that of ``settings``.
    """
    return Plugin(program, build_solver(plugin, program, _options(program, plugin, settings.tolerance, iterations)))


def fallback_plugin(program: Transcription, settings: SolverSettings) -> Plugin:
    """The fallback solver of the ``program``, as ``settings`` say."""
    options = _options(program, settings.fallback, settings.tolerance, settings.fallback_iterations)
    # IPOPT spends most of its time on linear algebra: not worth a compilation.
    return Plugin(program, ca.nlpsol("fallback", settings.fallback, program.nlp, options))


def _options(transcription: Transcription, plugin: str, tolerance: float, max_iterations: int) -> dict[str, object]:
    own: dict[str, object]
    if plugin == "fatrop":
        # Where guesses are good, a small first barrier saves a fifth of the iterations; elsewhere it costs nothing.
        own = {"print_level": 0, "tol": tolerance, "max_iter": max_iterations, "mu_init": 1e-3}
        return {"print_time": False, "fatrop": own, **transcription.structure}
    own = {"print_level": 0, "sb": "yes", "tol": tolerance, "max_iter": max_iterations, "acceptable_iter": 0}
    return {"print_time": False, "ipopt": own}


class Plugin:
    """CasADi's ``solver`` of the program ``transcription``, called through fixed memory, without conversions."""

    again = (Again(0.75, from_guess=False),)

    def __init__(self, transcription: Transcription, solver: ca.Function) -> None:
        self._buffer, self._call = solver.buffer()
        # The buffer keeps addresses, not references: these arrays must live as long as it does.
        inputs: dict[str, Array] = {solver.name_in(i): np.zeros(solver.numel_in(i)) for i in range(solver.n_in())}
        outputs: dict[str, Array] = {name: np.zeros(solver.numel_out(name)) for name in ("x", "f", "lam_g")}
        for name, array in inputs.items():
            self._buffer.set_arg(solver.index_in(name), memoryview(array))  # type: ignore[arg-type]
        for name, array in outputs.items():
            self._buffer.set_res(solver.index_out(name), memoryview(array))  # type: ignore[arg-type]
        self._lower, inputs["ubg"][:] = transcription.constraint_bounds
        self._inputs, self._transcription = inputs, transcription
        self.w, self.cost, self.lam_g = outputs["x"], outputs["f"], outputs["lam_g"]
        self._ended = ""

    def run(self, task: Task, lower: Array, upper: Array) -> tuple[Outcome, int]:
        """Solve ``task`` into ``w``, ``cost`` and ``lam_g``, with bounds ``lower`` and ``upper`` (nw,) of w.

        Returns:
            how it ended, and the number of iterations.
        """
        arguments = self._inputs
        arguments["x0"][:], arguments["p"][:] = task.guess, task.parameter
        arguments["lbx"][:], arguments["ubx"][:] = lower, upper
        arguments["lbg"][:] = self._lower if task.margin is None else self._transcription.lower_sides(task.margin)
        try:
            self._ended = ""
            self._call()
        except RuntimeError:
            return Outcome.BROKE_DOWN, 0
        stats = self._buffer.stats()
        iterations, self._ended = int(stats["iter_count"]), str(stats.get("return_status", ""))
        if not np.isfinite(self.w).all():
            return Outcome.BROKE_DOWN, iterations
        return Outcome.CONVERGED if stats["success"] else Outcome.STUCK, iterations

    def status(self, outcome: Outcome) -> Status:
        """The status of a solve that ended with the ``outcome`` of the last run."""
        if outcome is Outcome.CONVERGED:
            return Status.SOLVED
        if outcome is Outcome.STUCK and self._ended == _IPOPT_INFEASIBLE:
            return Status.INFEASIBLE
        if self._ended == _IPOPT_NOT_FINITE or not (np.isfinite(self.w).all() and np.isfinite(self.cost).all()):
            return Status.NOT_FINITE
        return Status.NOT_CONVERGED
