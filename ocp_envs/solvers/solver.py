"""Solving batches of problem instances, and the best known optimum of one instance."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.guard import Guard
from ocp_envs.solvers.guesses import bends_of, guesses, random_kind
from ocp_envs.solvers.nlp import Result, SolverSettings, Status, Task
from ocp_envs.solvers.reasons import not_finite, worst_violation
from ocp_envs.solvers.solutions import Solutions, best_per_mode, collect, make_tasks
from ocp_envs.solvers.transcription import Transcription, transcribe
from ocp_envs.support.arrays import Array
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.sharing import Loans, ProcessLock
from ocp_envs.trajectory import Trajectory

DEFAULT_SOLVER = SolverSettings()
#: Guesses of one solve for each winding.
_MOST_STARTS = 1000
#: Where many guesses are tried, one that hangs is given up soon.
OF_MANY_GUESSES = SolverSettings(hang_floor=0.3, hang_factor=10.0)


class Runner(Protocol):
    """What runs the solves of one program: a :class:`~ocp_envs.solvers.guard.Guard`, or a substitute in tests."""

    @property
    def restarts(self) -> int:
        """How often the process that solves was replaced."""

    def solve(self, tasks: Sequence[Task]) -> Iterable[Result]:
        """Results in the order of ``tasks``."""

    def start(self) -> object:
        """Get ready for the first task."""

    def close(self) -> None:
        """Release what ``start`` took."""


class Attempts(NamedTuple):
    """The ``solutions`` of B solves, and where they ended, solved or not: B trajectories ``ends``, NaN if unknown."""

    solutions: Solutions
    ends: Trajectory


class GuardedSolver:
    """Solves instances of ``problem`` in a child process, which is replaced where a solve hangs or crashes.

    The child starts with the first solve and ends with ``close``, the context or this process. The ``settings`` are
    those of the solves; ``runner`` makes what runs them. Threads that share it wait for each other; copies, and this
    object in a forked process, have children of their own.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        settings: SolverSettings = DEFAULT_SOLVER,
        runner: Callable[[Transcription, SolverSettings], Runner] = Guard,
    ) -> None:
        self.problem, self.settings = problem, settings
        self._transcription = transcribe(problem)
        self._runner, self._alone = runner, ProcessLock()
        self.runner = runner(self._transcription, settings)

    def __reduce__(self) -> tuple[object, ...]:
        return GuardedSolver, (self.problem, self.settings, self._runner)

    def __enter__(self) -> GuardedSolver:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def start(self) -> None:
        """Start the child now rather than with the first solve; compiles where that was not done before."""
        with self._alone:
            self.runner.start()

    def close(self) -> None:
        """End the child."""
        with self._alone:
            self.runner.close()

    @property
    def restarts(self) -> int:
        """How often the child had to be replaced."""
        return self.runner.restarts

    def solve(
        self,
        parameters: Array,
        guesses: Trajectory,
        windings: NDArray[np.integer],
        *,
        retry_with_fallback: bool = True,
        rescue: bool = True,
    ) -> Solutions:
        """Solve B instances, each from one guess.

        Args:
            parameters: (B, np).
            guesses: B trajectories; one that is not finite is not tried, its status is NOT_FINITE.
            windings: (B,) indices into ``problem.targets``, or :data:`~ocp_envs.solvers.guesses.NEAREST_WINDING`.
            retry_with_fallback: whether the fallback solver retries where the primary solver did not converge. With
                many guesses the next guess usually succeeds sooner.
            rescue: whether the fallback solver solves where the primary solver breaks down, hangs or crashes.

        Raises:
            ValueError: shapes or windings that do not fit.
            RuntimeError: the child cannot be started.
        """
        return self.attempts(
            parameters, guesses, windings, retry_with_fallback=retry_with_fallback, rescue=rescue
        ).solutions

    def attempts(
        self,
        parameters: Array,
        guesses: Trajectory,
        windings: NDArray[np.integer],
        *,
        retry_with_fallback: bool = True,
        rescue: bool = True,
        iterations: int | None = None,
        margins: Array | None = None,
    ) -> Attempts:
        """As :meth:`solve`, with the trajectories at which the solves that failed ended.

        The arguments, and the errors, are the same: ``parameters``, ``guesses``, ``windings``, ``retry_with_fallback``
        and ``rescue``. In addition, ``iterations`` limits the primary solver, which then makes one attempt, and
        ``margins`` (B, N − 1) are what the clearances at the knots k ≥ 1 have to be at least, 0 by default.
        """
        instances = self.problem, self._transcription, parameters
        tasks = make_tasks(*instances, guesses, windings, retry_with_fallback, rescue, iterations, margins)
        finite = guesses.finite
        with self._alone:
            solved = iter(list(self.runner.solve([task for task, good in zip(tasks, finite) if good])))
        nothing = Result.failed(Status.NOT_FINITE, self._transcription, False, 0.0)
        results = [next(solved) if good else nothing for good in finite]
        w = np.array([result.w for result in results]).reshape(len(results), len(nothing.w))
        ends = self._transcription.unpack(w, self.problem.start(parameters)[0])
        return Attempts(collect(*instances, results), ends)


@checked
@dataclass(frozen=True, eq=False)
class Solution:
    """The best known optimum of the instance with ``parameters`` (np,), and the best trajectory of every family.

    Trajectories begin in the turn in which the angles of ``parameters`` are written. Families are those of the same
    instance in the turn around the centre of the parameter box: their windings count from there. In ``modes`` each
    solution family of the problem has a row, EMPTY where no trajectory was found. The ``status`` is SOLVED where any
    family was found, otherwise how the last solve from a line failed; then the ``reason`` says in a sentence which
    constraint is violated, at which knot and by how much, or which function is not finite.
    """

    parameters: Array
    modes: Solutions
    status: Status
    reason: str = ""

    def __repr__(self) -> str:
        found = f"cost {self.cost:.6g}, mode {self.mode}" if self.mode is not None else "no trajectory"
        parameters = np.array2string(self.parameters, precision=4, separator=", ")
        return f"<Solution of {parameters}: {self.status.name}, {found}, of {len(self.modes)} solution families>"

    @property
    def mode(self) -> int | None:
        """The solution family of the best optimum; ``None`` where nothing was found."""
        return int(self.modes.cost.argmin()) if self.status == Status.SOLVED else None

    @property
    def cost(self) -> float:
        """The lowest cost found; +inf where nothing was found."""
        return float(self.modes.cost.min())

    @property
    def trajectory(self) -> Trajectory:
        """The best trajectory, a batch of one; NaN where nothing was found."""
        return self.modes.trajectory[self.mode or 0]


@lru_cache(maxsize=8)
def _solvers(problem: OptimalControlProblem, settings: SolverSettings, process: int) -> Loans[GuardedSolver]:
    """The solvers of ``problem`` with ``settings`` in the process with that id, at most one for each core."""
    return Loans(partial(GuardedSolver, problem, settings), os.cpu_count() or 1)


def lent_solvers(problem: OptimalControlProblem, settings: SolverSettings = OF_MANY_GUESSES) -> Loans[GuardedSolver]:
    """Solvers of ``problem`` with ``settings`` that this process keeps; its threads use as many as there are cores."""
    return _solvers(problem, settings, os.getpid())


@checked
def solve(problem: ProblemOrId, p: ArrayLike, *, extrapolate: bool = False, seed: int = 0, starts: int = 6) -> Solution:
    """The best known optimum of one instance, by multistart over the goal's windings.

    The solver process is kept for the next call. Threads may call this at once; they use as many as there are cores. An
    instance whose initial state or goal violates a constraint is told at once, as INFEASIBLE.

    Args:
        problem: the problem.
        p: parameters of the instance, (np,), their angles in any turn.
        extrapolate: accept parameters outside the problem's box.
        seed: of the random guesses.
        starts: guesses for each winding, at most 1000: one straight line, the others random.

    Raises:
        ValueError: more than one instance, parameters that are not finite or outside the box, or starts out of range.
    """
    problem = problem_of(problem)
    given = problem.check_parameters(p, extrapolate)
    parameters, turns = problem.in_one_turn(given)
    if len(parameters) != 1:
        raise ValueError(f"solve takes one instance, got {len(parameters)}")
    check_whole("starts", starts, 1, _MOST_STARTS)
    if hopeless := infeasible_rows(problem, parameters):
        return Solution(given[0], Solutions.empty(problem, len(problem.modes)), Status.INFEASIBLE, hopeless[0])
    with lent_solvers(problem).one() as solver:
        found = _multistart(solver, parameters, np.random.default_rng(seed), starts)
    modes = best_per_mode(problem, parameters[0], found.solutions)
    status, reason = (Status.SOLVED, "") if found.solutions.solved.any() else _why(problem, parameters, found)
    return Solution(given[0], replace(modes, trajectory=modes.trajectory.shifted(turns)), status, reason)


def _multistart(solver: GuardedSolver, parameters: Array, rng: np.random.Generator, starts: int) -> Attempts:
    """Solves of one instance from ``starts`` guesses for each winding, at first from lines.

    A guess that fails is given up. Only where all fail the fallback solver is used, from the lines.
    """
    problem, count = solver.problem, len(solver.problem.targets)
    windings, repeated = np.arange(count), np.repeat(parameters, count, axis=0)

    def attempt(tried: Sequence[Trajectory], last_resort: bool = False) -> Attempts:
        return solver.attempts(
            np.tile(repeated, (len(tried), 1)),
            Trajectory.concatenate(tried),
            np.tile(windings, len(tried)),
            retry_with_fallback=last_resort,
            rescue=last_resort,
        )

    lines = guesses(problem, repeated, windings, rng, "line")
    first, kind = attempt([lines]).solutions, random_kind(problem)
    others = [
        bends_of(problem, lines, first.solved, first.trajectory, rng)
        if kind == "bend"
        else guesses(problem, repeated, windings, rng, kind)
        for _ in range(starts - 1)
    ]
    solutions = Solutions.concatenate([first, attempt(others).solutions]) if others else first
    return Attempts(solutions, first.trajectory) if solutions.solved.any() else attempt([lines], last_resort=True)


def _why(problem: OptimalControlProblem, parameters: Array, failed: Attempts) -> tuple[Status, str]:
    """How the solves of one instance, with ``parameters`` (1, np), ``failed`` from lines, and why."""
    repeated = np.repeat(parameters, len(failed.ends), axis=0)
    lines = guesses(problem, repeated, np.arange(len(repeated)), np.random.default_rng(0), "line")
    for trajectory in (lines, failed.ends):
        if reason := not_finite(problem, repeated, trajectory):
            return Status.NOT_FINITE, reason
    return Status(int(failed.solutions.status[0])), worst_violation(problem, repeated, failed.ends)
