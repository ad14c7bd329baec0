"""Solving many instances at once, each as :func:`~ocp_envs.solvers.optimum.solve` does; nothing is stored."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass

import cloudpickle
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.data.samples import Samples
from ocp_envs.data.worker import kept_solver
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.failure import Failure
from ocp_envs.solvers.guesses import Guess, guesses_of
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.optimum import Multistart, Solution, solved_from, told_at_once
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.solvers.solver import OF_MANY_GUESSES, GuardedSolver, lent_solvers
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.progress import Progress
from ocp_envs.support.tasks import TaskRun
from ocp_envs.support.workers import Workers
from ocp_envs.trajectory import Trajectory

#: Instances of a task: few, so that all workers have some.
_TASK = 10


@checked
@dataclass(frozen=True, eq=False)
class Optima:
    """The best known optima of B instances of ``problem``, a :class:`Solution` ``each``.

    Samples for learning are made of those that are solved (:meth:`samples`), as of a database.
    """

    problem: OptimalControlProblem
    each: Sequence[Solution]

    def __repr__(self) -> str:
        found = ", ".join(f"{count} {name}" for name, count in self.counts.items())
        return f"<Optima of {len(self)} instances of {self.problem.id!r}: {found or 'none'}>"

    def __len__(self) -> int:
        return len(self.each)

    def __iter__(self) -> Iterator[Solution]:
        return iter(self.each)

    def __getitem__(self, row: int) -> Solution:
        """The solution of the instance in ``row``."""
        return self.each[row]

    @property
    def counts(self) -> dict[str, int]:
        """How many instances ended with each status, the most frequent one first."""
        return dict(Counter(each.status.name for each in self.each).most_common())

    @property
    def parameters(self) -> Array:
        """(B, np)."""
        return np.array([each.parameters for each in self.each]).reshape(len(self), len(self.problem.parameters))

    @property
    def status(self) -> NDArray[np.int8]:
        """How the solves ended, values of :class:`Status`, (B,)."""
        return np.array([each.status for each in self.each], dtype=np.int8)

    @property
    def solved(self) -> Bools:
        """Which instances have an optimum, (B,)."""
        return self.status == Status.SOLVED

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each instance was not solved; "" where it was."""
        return tuple(each.reason for each in self.each)

    @property
    def failures(self) -> dict[int, Failure]:
        """Why instances were not solved, and what to try, by their rows."""
        return {row: each.failure for row, each in enumerate(self.each) if each.failure is not None}

    @property
    def mode_costs(self) -> Array:
        """The best cost of every solution family, (B, modes); +inf where no trajectory of it was found."""
        return np.array([each.modes.cost for each in self.each]).reshape(len(self), len(self.problem.modes))

    @property
    def cost(self) -> Array:
        """The lowest costs found, (B,); +inf where nothing was found."""
        return self.mode_costs.min(axis=1)

    @property
    def mode(self) -> Ints:
        """The solution families of the best optima, (B,); meaningless where nothing was found."""
        return self.mode_costs.argmin(axis=1)

    @property
    def trajectory(self) -> Trajectory:
        """The best trajectories, B of them; NaN where nothing was found."""
        return self._best.trajectory

    @property
    def _best(self) -> Solutions:
        nothing = Solutions.empty(self.problem, 0)
        return Solutions.concatenate([nothing, *(each.modes[each.mode or 0] for each in self.each)])

    def samples(self) -> Samples:
        """The optima that were found, to learn from."""
        rows, best = np.flatnonzero(self.solved), self._best
        return Samples(
            problem=self.problem,
            parameters=self.parameters[rows],
            trajectory=best.trajectory[rows],
            mode=self.mode[rows],
            cost=self.cost[rows],
            multipliers=best.multipliers[rows],
            mode_costs=self.mode_costs[rows],
            index=rows,
        )


@dataclass(frozen=True, eq=False)
class _Task:
    """Instances from row ``begin`` on, of the pickled ``problem``, with ``parameters`` (B, np).

    Each is solved from its row of every ``guess``, B trajectories, and as ``multistart`` says.
    """

    begin: int
    problem: bytes
    parameters: Array
    guess: Sequence[Trajectory]
    multistart: Multistart


@checked
def solve_many(
    problem: ProblemOrId,
    p: ArrayLike,
    guesses: Guess | None = None,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    extrapolate: bool = False,
    seed: int = 0,
    starts: int | None = None,
    progress: bool | None = None,
) -> Optima:
    """The best known optima of many instances, each as :func:`ocp_envs.solve` finds it.

    Nothing is stored: for databases that are to be kept, with warm starts from neighbouring instances, see
    :func:`ocp_envs.generate`. By default threads of this process wait for solver processes, which are kept for the next
    call.

    Args:
        problem: the problem.
        p: parameters of the instances, (B, np), their angles in any turn.
        guesses: where the solver begins: B trajectories, several times B, or a function from parameters (B, np) to
            these, such as a planner. By default, and in addition where ``starts`` are given, a multistart.
        executor: any ``concurrent.futures`` executor, such as a Dask cluster's ``client.get_executor()``.
        workers: solver processes, or tasks that ``executor`` runs at once; one per core where not given.
        extrapolate: accept parameters outside the problem's box.
        seed: of the random guesses.
        starts: guesses for each winding, as for :func:`ocp_envs.solve`.
        progress: show it, as :func:`ocp_envs.generate` does.

    Raises:
        TypeError: guesses that are neither trajectories nor a function that returns some.
        ValueError: parameters that are not finite or outside the box, numbers out of range, or guesses of another
            shape.
    """
    problem = problem_of(problem)
    if workers is not None:
        check_whole("workers", workers)
    given = problem.check_parameters(p, extrapolate)
    multistart = Multistart.of(starts, seed, guesses is not None)
    tried = guesses_of(problem, given, guesses, "guesses") if len(given) else []
    found: dict[int, Solution] = {}
    bar = Progress(len(given), unit="instance", label=f"{problem.id}, solve_many", shown=progress)

    def take(task: _Task, solutions: list[Solution]) -> None:
        found.update(enumerate(solutions, start=task.begin))
        bar.update(len(solutions), failed=sum(each.status != Status.SOLVED for each in found.values()))

    with bar, _running(problem, executor, workers) as (call, pool):
        TaskRun(call, pool, take, resumes="nothing is stored")(_tasks(problem, given, tried, multistart))
    return Optima(problem, tuple(found[row] for row in range(len(given))))


@contextlib.contextmanager
def _running(
    problem: OptimalControlProblem, executor: Executor | None, workers: int | None
) -> Iterator[tuple[Callable[[_Task], list[Solution]], Workers]]:
    """What solves a task of ``problem``, and the workers that call it: those of ``executor``, or threads."""
    if executor is not None:
        yield _solve, Workers.of(executor, workers)
        return

    def solve_here(task: _Task) -> list[Solution]:
        with lent_solvers(problem).one() as solver:
            return _solved(solver, task)

    with ThreadPoolExecutor(workers or os.cpu_count()) as threads:
        yield solve_here, Workers.of(threads, workers)


def _tasks(
    problem: OptimalControlProblem, given: Array, guess: Sequence[Trajectory], multistart: Multistart
) -> Iterator[_Task]:
    payload = cloudpickle.dumps(problem)
    for begin in range(0, len(given), _TASK):
        rows = slice(begin, begin + _TASK)
        yield _Task(begin, payload, given[rows], [each[rows] for each in guess], multistart)


def _solve(task: _Task) -> list[Solution]:
    """The solutions of ``task``, in a process that keeps a solver child for each thread that solves."""
    return _solved(kept_solver(task.problem, OF_MANY_GUESSES), task)


def _solved(solver: GuardedSolver, task: _Task) -> list[Solution]:
    told = told_at_once(solver.problem, task.parameters)
    return [
        told.get(row)
        or solved_from(solver, task.parameters[row : row + 1], [each[row] for each in task.guess], task.multistart)
        for row in range(len(task.parameters))
    ]
