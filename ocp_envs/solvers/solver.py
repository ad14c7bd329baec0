"""Solving batches of problems, and the best known optimum of one."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import Check, verify
from ocp_envs.solvers.guard import Factory, Guard
from ocp_envs.solvers.guesses import Kind, guesses, random_kind
from ocp_envs.solvers.nlp import NlpSolver, SolverSettings, Status
from ocp_envs.solvers.solutions import Solutions, best_per_mode, collect, make_tasks
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory

__all__ = [
    "Check",
    "GuardedSolver",
    "Solution",
    "Solutions",
    "Solver",
    "SolverSettings",
    "Status",
    "best_per_mode",
    "guesses",
    "solve",
    "verify",
]


DEFAULT_SETTINGS = SolverSettings()


class Solver:
    """Solves problems in this process; a solver that hangs hangs it (see :class:`GuardedSolver`)."""

    def __init__(self, problem: OptimalControlProblem, settings: SolverSettings = DEFAULT_SETTINGS) -> None:
        self.problem, self.settings = problem, settings
        self._transcription = transcribe(problem)
        self._nlp = NlpSolver(self._transcription, settings)

    def solve(
        self, parameters: Array, guesses: Trajectory, windings: NDArray[np.integer], persist: bool = True
    ) -> Solutions:
        """Solve B problems, each from one guess.

        Args:
            parameters: (B, np).
            guesses: B trajectories.
            windings: (B,) indices into ``problem.targets``; −1 takes the target nearest to the guess's end.
            persist: whether the fallback solver goes on where the primary did not converge; a caller with many guesses
                had better try the next one.

        Raises:
            ValueError: shapes or windings that do not fit, guesses that are not finite.
        """
        tasks = make_tasks(self.problem, self._transcription, parameters, guesses, windings, persist)
        results = [self._nlp.solve(task) for task in tasks]
        return collect(self.problem, self._transcription, parameters, results)


class GuardedSolver:
    """Solves problems in a child process, which is replaced where a solve hangs or crashes.

    The child starts with the first solve and ends with ``close``, the context or this process.

    Args:
        problem: the problem.
        settings: settings of the solves.
        factory: makes the solver in the child; for tests of what the guard guards against.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        settings: SolverSettings = DEFAULT_SETTINGS,
        factory: Factory = NlpSolver,
    ) -> None:
        self.problem, self.settings = problem, settings
        self._transcription = transcribe(problem)
        self._guard = Guard(self._transcription, settings, factory)

    def __enter__(self) -> GuardedSolver:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def start(self) -> None:
        """Start the child now rather than with the first solve; compiles where that was not done before."""
        self._guard.start()

    def close(self) -> None:
        """End the child."""
        self._guard.close()

    @property
    def restarts(self) -> int:
        """How often the child had to be replaced."""
        return self._guard.restarts

    def solve(
        self, parameters: Array, guesses: Trajectory, windings: NDArray[np.integer], persist: bool = True
    ) -> Solutions:
        """As :meth:`Solver.solve`, whatever the solver does.

        Raises:
            RuntimeError: the child cannot be started.
        """
        tasks = make_tasks(self.problem, self._transcription, parameters, guesses, windings, persist)
        return collect(self.problem, self._transcription, parameters, self._guard.solve(tasks))


@dataclass(frozen=True, eq=False)
class Solution:
    """The best known optimum of one parameter, and the best of every mode that was found.

    Args:
        parameters: p, (np,).
        modes: one row for each mode of the problem; EMPTY where none was found.
        status: SOLVED where any mode was found, else how the first solve failed.
    """

    parameters: Array
    modes: Solutions
    status: Status

    @property
    def mode(self) -> int | None:
        """The mode of the best optimum; ``None`` where nothing was found."""
        return int(self.modes.cost.argmin()) if self.status == Status.SOLVED else None

    @property
    def cost(self) -> float:
        """The lowest cost found; +inf where nothing was."""
        return float(self.modes.cost.min())

    @property
    def trajectory(self) -> Trajectory:
        """The best trajectory, a batch of one; NaN where nothing was found."""
        return self.modes.trajectory[self.mode or 0]


@lru_cache(maxsize=4)
def _shared_solver(problem: OptimalControlProblem, process: int, thread: int) -> GuardedSolver:
    return GuardedSolver(problem)


def solve(
    problem: OptimalControlProblem, p: ArrayLike, *, extrapolate: bool = False, seed: int = 0, starts: int = 6
) -> Solution:
    """The best known optimum of one parameter, by multistart over the goal's windings.

    The solver process is kept for the next call.

    Args:
        p: parameter, (np,).
        extrapolate: accept a parameter outside the problem's box.
        seed: of the random guesses.
        starts: guesses for each winding: one straight line, the others random.

    Raises:
        ValueError: not one parameter, not finite, outside the box, or no starts.
    """
    parameters = problem.check_parameters(p, extrapolate)
    if len(parameters) != 1 or starts < 1:
        raise ValueError(f"solve takes one parameter and starts ≥ 1, got {len(parameters)} and {starts}")
    rng, count = np.random.default_rng(seed), len(problem.targets)
    windings = np.arange(count)
    repeated = np.repeat(parameters, count, axis=0)
    kinds: list[Kind] = ["line", *[random_kind(problem)] * (starts - 1)]
    tried = [guesses(problem, repeated, windings, rng, kind) for kind in kinds]
    # A forked process must not talk to its parent's child, nor a thread to another thread's.
    solver = _shared_solver(problem, os.getpid(), threading.get_ident())
    solutions = solver.solve(
        np.tile(repeated, (starts, 1)), Trajectory.concatenate(tried), np.tile(windings, starts), persist=False
    )
    modes = best_per_mode(problem, parameters[0], solutions)
    status = Status.SOLVED if solutions.solved.any() else Status(int(solutions.status[0]))
    return Solution(parameters[0], modes, status)
