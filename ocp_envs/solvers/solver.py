"""Solving batches of problem instances in a child process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guard import Guard
from ocp_envs.solvers.nlp import Result, SolverSettings, Status, Task
from ocp_envs.solvers.solutions import Solutions, collect, make_tasks
from ocp_envs.solvers.transcription import Transcription, transcribe
from ocp_envs.support.arrays import Array
from ocp_envs.support.sharing import Loans, ProcessLock
from ocp_envs.trajectory import Trajectory

DEFAULT_SOLVER = SolverSettings()
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


@lru_cache(maxsize=8)
def _solvers(problem: OptimalControlProblem, settings: SolverSettings, process: int) -> Loans[GuardedSolver]:
    """The solvers of ``problem`` with ``settings`` in the process with that id, at most one for each core."""
    return Loans(partial(GuardedSolver, problem, settings), os.cpu_count() or 1)


def lent_solvers(problem: OptimalControlProblem, settings: SolverSettings = OF_MANY_GUESSES) -> Loans[GuardedSolver]:
    """Solvers of ``problem`` with ``settings`` that this process keeps; its threads use as many as there are cores."""
    return _solvers(problem, settings, os.getpid())
