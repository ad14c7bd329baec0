"""One nonlinear program, solved many times: the part of the solver that runs in a child process.

The primary solver is fatrop (Vanroye et al., *FATROP: a fast constrained optimal control problem solver for robot
trajectory optimization and control*, IROS 2023), with compiled functions. It has no restoration phase: where its line
search gets stuck, usually with the duration at its lower bound, a second attempt continues from there with a longer
duration. *Measured* on 600 random pendulum instances, this recovers twice as many as IPOPT with its restoration, in a
tenth of the time.

The fallback is IPOPT (Wächter & Biegler, *On the implementation of an interior-point filter line-search algorithm for
large-scale nonlinear programming*, 2006). It solves what the primary solver breaks down on: an exception, a number that
is not finite, a hang or a crash (see :mod:`ocp_envs.solvers.guard`); and, if the caller asks for it, what the primary
solver did not converge on. Iteration limits decide how a solve ends, never time.
"""

from __future__ import annotations

import enum
import time
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from ocp_envs.solvers import cpu_limit
from ocp_envs.solvers.compilation import build_solver
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked


class Status(enum.IntEnum):
    """How a solve ended; stored in databases as int8."""

    EMPTY = 0  #: not tried, or no such solution family
    SOLVED = 1
    NOT_CONVERGED = 2  #: the tolerance was not reached within the iterations
    TIMED_OUT = 3  #: both solvers had to be killed, the last one for taking too long
    CRASHED = 4  #: the process of the last solver died
    CHECK_FAILED = 5  #: the solver reports success, but the independent check fails
    INFEASIBLE = 6  #: an end violates a constraint, or IPOPT found that none of the nearby trajectories meets all
    NOT_FINITE = 7  #: the guess, or a value or derivative that the solver met, is NaN or infinite


@checked
@dataclass(frozen=True)
class SolverSettings:
    """Settings of a solve.

    Args:
        primary: "fatrop" or "ipopt"; the other one is the fallback.
        tolerance: scaled optimality tolerance of either solver.
        max_iterations, fallback_iterations: limits of an attempt of the primary and of the fallback solver.
        hang_factor, hang_floor: an attempt of the primary solver counts as hung after the larger of ``hang_factor`` ×
            the running median time of a solve and ``hang_floor`` seconds of processor time.
    """

    primary: str = "fatrop"
    tolerance: float = 1e-6
    max_iterations: int = 150
    fallback_iterations: int = 200
    hang_factor: float = 100.0
    hang_floor: float = 5.0

    def __post_init__(self) -> None:
        if self.primary not in ("fatrop", "ipopt"):
            raise ValueError(f'primary must be "fatrop" or "ipopt", got {self.primary!r}')
        positive = (self.tolerance, self.max_iterations, self.fallback_iterations, self.hang_factor, self.hang_floor)
        if not all(value > 0 for value in positive):
            raise ValueError(f"tolerance, limits and times must be positive, got {self}")

    @property
    def fallback(self) -> str:
        """The solver that is not the primary one."""
        return "ipopt" if self.primary == "fatrop" else "fatrop"


#: What IPOPT calls two ways of ending.
_IPOPT_INFEASIBLE, _IPOPT_NOT_FINITE = "Infeasible_Problem_Detected", "Invalid_Number_Detected"
#: Duration of the second attempt, as a fraction of the longest one.
_SECOND_DURATION = 0.75


class Task(NamedTuple):
    """One solve in scaled variables, from ``guess`` w (nw,), for ``parameter`` [x_0; s] (nx + nc,).

    The goal state has the index ``target``. Where the primary solver does not converge, the fallback continues if
    ``retry_with_fallback``; where it breaks down, hangs or crashes, the fallback solves the task if ``rescue``.
    With a number of ``iterations`` the primary solver makes so many at most, in one attempt. The clearances at the
    knots k ≥ 1 are at least the ``margin`` (N − 1,), in their unit, by default 0.
    """

    guess: Array
    parameter: Array
    target: int
    retry_with_fallback: bool = True
    rescue: bool = True
    iterations: int | None = None
    margin: Array | None = None


class Result(NamedTuple):
    """How one solve ended: ``status``, ``iterations`` of both solvers, use of the ``fallback``, time in ``seconds``.

    The scaled variables ``w`` (nw,), the ``cost`` J and the ``multipliers`` (N − 1, nh) of the clearances at the knots
    k ≥ 1 are meaningless unless SOLVED.
    """

    status: Status
    w: Array
    cost: float
    multipliers: Array
    iterations: int
    fallback: bool
    seconds: float

    @classmethod
    def failed(cls, status: Status, transcription: Transcription, fallback: bool, seconds: float) -> Result:
        """The result of a solve of ``transcription`` of which only how it ended is known.

        This is its ``status``, whether the ``fallback`` solver was used, and its ``seconds``.
        """
        w, multipliers = (
            np.full(transcription.lower.shape, np.nan),
            np.full(transcription.rows.clearances.shape, np.nan),
        )
        return cls(status, w, np.nan, multipliers, 0, fallback, seconds)


class Outcome(enum.Enum):
    """How one run of one solver ended."""

    CONVERGED = enum.auto()
    STUCK = enum.auto()  #: at a finite point, for want of progress or of iterations
    BROKE_DOWN = enum.auto()  #: an exception, or values that are not finite


class NlpSolver:
    """The two solvers of the program ``transcription``, as ``settings`` say; not to be shared between threads."""

    def __init__(self, transcription: Transcription, settings: SolverSettings) -> None:
        self._transcription, self._settings = transcription, settings
        self.primary = self._primary(settings.max_iterations)
        self._limited: dict[int, Backend] = {}

    def _primary(self, iterations: int) -> Backend:
        """The primary solver with a limit of ``iterations``."""
        program, s = self._transcription, self._settings
        options = _options(program, s.primary, s.tolerance, iterations)
        return Backend(program, build_solver(s.primary, program, options))

    def _limited_to(self, iterations: int) -> Backend:
        """The primary solver with a limit of ``iterations``; kept, since setting it up takes longer than a solve."""
        if iterations not in self._limited:
            self._limited[iterations] = self._primary(iterations)
        return self._limited[iterations]

    @cached_property
    def fallback(self) -> Backend:
        """The fallback solver; made when it is needed, for it rarely is."""
        program, s = self._transcription, self._settings
        # IPOPT spends most of its time on linear algebra: not worth a compilation.
        options = _options(program, s.fallback, s.tolerance, s.fallback_iterations)
        return Backend(program, ca.nlpsol("fallback", s.fallback, program.nlp, options))

    def solve(self, task: Task, skip_primary: bool = False) -> Result:
        """Solve ``task`` with the primary solver, in two attempts, then where necessary with the fallback.

        With ``skip_primary`` the fallback is used at once.
        """
        began = time.perf_counter()
        bounds = self._transcription.bounds(task.target, task.parameter[self._transcription.nx :])
        primary = self.primary if task.iterations is None else self._limited_to(task.iterations)
        backend, outcome, iterations = primary, Outcome.BROKE_DOWN, 0
        if not skip_primary:
            outcome, iterations = backend.run(task, *bounds)
            if outcome is Outcome.STUCK and task.iterations is None:
                longer = task._replace(guess=self._transcription.with_duration(backend.w, _SECOND_DURATION, *bounds))
                outcome, more = backend.run(longer, *bounds)
                iterations += more
        retry = {Outcome.STUCK: task.retry_with_fallback, Outcome.BROKE_DOWN: task.rescue or skip_primary}
        if retry.get(outcome, False):
            cpu_limit.begin_fallback()
            if outcome is Outcome.STUCK:
                task = task._replace(guess=backend.w)
            backend = self.fallback
            outcome, more = backend.run(task, *bounds)
            iterations += more
        return Result(
            status=backend.status(outcome),
            w=backend.w.copy(),
            cost=float(backend.cost[0]) * self._transcription.cost_scale,
            multipliers=self._transcription.clearance_multipliers(backend.lam_g),
            iterations=iterations,
            fallback=backend is not primary,
            seconds=time.perf_counter() - began,
        )


def _options(transcription: Transcription, plugin: str, tolerance: float, max_iterations: int) -> dict[str, object]:
    own: dict[str, object]
    if plugin == "fatrop":
        # Where guesses are good, a small first barrier saves a fifth of the iterations; elsewhere it costs nothing.
        own = {"print_level": 0, "tol": tolerance, "max_iter": max_iterations, "mu_init": 1e-3}
        return {"print_time": False, "fatrop": own, **transcription.structure}
    own = {"print_level": 0, "sb": "yes", "tol": tolerance, "max_iter": max_iterations, "acceptable_iter": 0}
    return {"print_time": False, "ipopt": own}


class Backend:
    """CasADi's ``solver`` of the program ``transcription``, called through fixed memory, without conversions."""

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
