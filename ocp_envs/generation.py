"""Generation of databases: multistart on a first subset, then warm starts from neighbours, in rounds.

Problems are put into a random order and solved in rounds of n₀, 2n₀, 4n₀ … problems. In the first round every winding
of the goal is tried from several guesses. In a later round a problem looks at its nearest neighbours among the problems
of *earlier* rounds, takes from them the modes that are best or nearly best there, and starts each from the solutions of
the nearest neighbours that have it (Tang & Hauser, section III-B, after Tang, Sun & Hauser's nearest-neighbour method).
So what is solved depends on the problem, the settings and the seed alone, and not on the number of workers or on
interruptions.

A task is a chunk of problems with their guesses. Only the calling process writes; a killed worker costs its chunk, a
killed parent the chunks in flight, and the same call again goes on from there.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from functools import lru_cache
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from tqdm import tqdm

from ocp_envs.database import Database, DatabaseError, Rows
from ocp_envs.guesses import Kind, guesses
from ocp_envs.nlp import SolverSettings, Status
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solutions import Solutions, best_per_mode
from ocp_envs.solver import GuardedSolver
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory

_NEAREST_TARGET = -1
#: A winding that failed from so many guesses is given up: most such goals are out of reach in the time allowed.
_PATIENCE = 2
#: Times each task in flight may lose its worker, without any chunk coming in between, before that is an error.
_RETRIES = 3


@dataclass(frozen=True)
class GenerationSettings:
    """How a database is made.

    Args:
        first: n₀, problems of the first round; at least one chunk.
        starts: guesses for each winding in the first round.
        neighbours: warm starts for each mode that is tried.
        lookaround: neighbours whose modes are considered.
        margin: a neighbour's mode is tried if it costs at most this share more than the neighbour's best.
        cold: guesses for each winding in later rounds, beside the warm starts.
        chunk: problems of a task.
        solver: settings of the solves.
    """

    first: int = 200
    starts: int = 8
    neighbours: int = 2
    lookaround: int = 8
    margin: float = 0.3
    cold: int = 0
    chunk: int = 100
    solver: SolverSettings = field(default_factory=SolverSettings)

    def __post_init__(self) -> None:
        least = {"first": 1, "starts": 1, "neighbours": 1, "lookaround": 1, "cold": 0, "chunk": 1}
        for name, value in least.items():
            if getattr(self, name) < value:
                raise ValueError(f"{name} must be at least {value}, got {getattr(self, name)}")
        if not self.margin >= 0:
            raise ValueError(f"margin must be at least 0, got {self.margin}")


DEFAULT = GenerationSettings()


@dataclass(frozen=True, eq=False)
class Task:
    """A chunk of problems.

    Args:
        chunk: its number.
        problem: the problem, pickled by value.
        settings: how.
        seed: of the chunk's random guesses.
        parameters: (B, np).
        owner, z: row and flat guess of every warm start.
        cold: random guesses for every winding.
    """

    chunk: int
    problem: bytes
    settings: GenerationSettings
    seed: tuple[int, ...]
    parameters: Array
    owner: NDArray[np.int64]
    z: NDArray[np.float32]
    cold: int


# -- in the worker -----------------------------------------------------------------------------------------------------


@lru_cache(maxsize=2)
def _worker(problem: bytes, settings: SolverSettings, process: int) -> tuple[OptimalControlProblem, GuardedSolver]:
    loaded: OptimalControlProblem = cloudpickle.loads(problem)
    return loaded, GuardedSolver(loaded, settings)


def solve_chunk(task: Task) -> Rows:
    """Solve all problems of ``task``, in a process that keeps one solver child of its own."""
    problem, solver = _worker(task.problem, task.settings.solver, os.getpid())
    owner, solutions = [], []
    if len(task.owner):
        guess = _start_from(problem, task.parameters[task.owner], task.z)
        solutions.append(solver.solve(task.parameters[task.owner], guess, np.full(len(task.owner), _NEAREST_TARGET)))
        owner.append(task.owner)
    for rows, found in _multistart(problem, solver, task):
        owner.append(rows)
        solutions.append(found)
    return _rows(problem, len(task.parameters), np.concatenate(owner), Solutions.concatenate(solutions))


def _start_from(problem: OptimalControlProblem, parameters: Array, z: NDArray[np.float32]) -> Trajectory:
    """Neighbours' solutions as guesses; the first state is the problem's own."""
    guess = Trajectory.from_flat(z, problem.knots, problem.system.nx, problem.system.nu)
    guess.states[:, 0] = problem.start(parameters)[0]
    return guess


def _multistart(
    problem: OptimalControlProblem, solver: GuardedSolver, task: Task
) -> Iterator[tuple[NDArray[np.int64], Solutions]]:
    """Row and solution of every random guess; windings that keep failing are given up."""
    targets = len(problem.targets)
    rows = np.repeat(np.arange(len(task.parameters)), targets)
    windings = np.tile(np.arange(targets), len(task.parameters))
    reached = np.zeros(len(rows), dtype=bool)
    rng = np.random.default_rng(task.seed)
    for attempt in range(task.cold):
        kind: Kind = "line" if attempt == 0 else "drift"
        guess = guesses(problem, task.parameters[rows], windings, rng, kind)
        open_ = np.flatnonzero(reached | (attempt < _PATIENCE))
        if not len(open_):
            return
        found = solver.solve(task.parameters[rows[open_]], guess[open_], windings[open_], persist=False)
        reached[open_] |= found.solved
        yield rows[open_], found


def _rows(problem: OptimalControlProblem, size: int, owner: NDArray[np.int64], solutions: Solutions) -> Rows:
    """What the solves of a chunk give its rows."""
    order = np.argsort(owner, kind="stable")
    groups = np.split(order, np.searchsorted(owner[order], np.arange(1, size)))
    best = [best_per_mode(problem, solutions[group]) for group in groups]
    slots = Solutions.concatenate(best)
    shape = (size, len(problem.modes))
    failed = ~solutions.solved
    solved = slots.solved.reshape(shape).any(axis=1)
    # A row without any solution ended as its first solve did.
    first = np.array([solutions.status[group[0]] if len(group) else Status.EMPTY for group in groups], dtype=np.int8)

    def count(weights: NDArray[Any]) -> NDArray[np.int32]:
        return np.bincount(owner, weights, size).astype(np.int32)

    return Rows(
        status=np.where(solved, np.int8(Status.SOLVED), first),
        slot_status=slots.status.reshape(shape),
        cost=np.where(slots.solved, slots.cost, np.inf).reshape(shape),
        z=slots.trajectory.flat().reshape(*shape, problem.flat_size),
        multipliers=slots.multipliers.reshape(*shape, problem.knots, problem.n_clearances),
        solves=count(np.ones(len(owner))),
        failures=count(failed),
        fallbacks=count(solutions.fallback),
        iterations=count(solutions.iterations),
    )


# -- neighbours --------------------------------------------------------------------------------------------------------


class _Library:
    """The solutions of finished rounds, by nearest parameters.

    Args:
        problem: the problem.
        parameters: (M, np) of the rows.
        rows: what was found for them.
    """

    def __init__(self, problem: OptimalControlProblem, parameters: Array, rows: Rows) -> None:
        self._width = problem.parameters.upper - problem.parameters.lower
        self._cost = rows.cost
        self._tree = cKDTree(parameters / self._width)
        self._by_mode: dict[int, tuple[Any, NDArray[np.float32]]] = {}
        for mode in range(rows.cost.shape[1]):
            have = np.isfinite(rows.cost[:, mode])
            if have.any():
                tree = cKDTree(parameters[have] / self._width)
                self._by_mode[mode] = (tree, rows.z[have, mode].astype(np.float32))

    def warm_starts(
        self, parameters: Array, settings: GenerationSettings
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Row and flat guess of every warm start of ``parameters`` (B, np), ordered by row."""
        scaled = parameters / self._width
        look = range(1, min(settings.lookaround, len(self._cost)) + 1)
        cost = self._cost[self._tree.query(scaled, k=look)[1]]
        with np.errstate(invalid="ignore"):
            near = cost <= (1 + settings.margin) * cost.min(axis=2, keepdims=True)
        wanted = (near & np.isfinite(cost)).any(axis=1)
        owner, guess = [], []
        for mode, (tree, z) in self._by_mode.items():
            rows = np.flatnonzero(wanted[:, mode])
            nearest = tree.query(scaled[rows], k=range(1, min(settings.neighbours, len(z)) + 1))[1]
            owner.append(np.repeat(rows, nearest.shape[1]))
            guess.append(z[nearest.ravel()])
        if not owner:
            return np.empty(0, np.int64), np.empty((0, 0), np.float32)
        every = np.concatenate(owner)
        order = np.argsort(every, kind="stable")
        return every[order], np.concatenate(guess)[order]


def _rounds(database: Database, settings: GenerationSettings) -> list[range]:
    """Chunks of every round: n₀, 2n₀, 4n₀ … problems, in whole chunks."""
    size = max(1, -(-settings.first // settings.chunk))
    rounds, begin = [], 0
    while begin < database.chunks:
        rounds.append(range(begin, min(begin + size, database.chunks)))
        begin += size
        size *= 2
    return rounds


def _tasks(database: Database, settings: GenerationSettings, seed: int, chunks: range) -> Iterator[Task]:
    """The tasks of a round that are not done yet."""
    problem = database.problem
    payload = cloudpickle.dumps(problem)
    present = database.present()
    missing = [chunk for chunk in chunks if not present[chunk]]
    library = None
    if missing and chunks.start > 0:
        earlier = slice(0, database.stored_rows(chunks.start).start)
        library = _Library(problem, database.stored_parameters(earlier), database.stored(earlier))
    for chunk in missing:
        p = database.stored_parameters(database.stored_rows(chunk))
        if library is None:
            owner, z, cold = np.empty(0, np.int64), np.empty((0, problem.flat_size), np.float32), settings.starts
        else:
            owner, z = library.warm_starts(p, settings)
            # Where no neighbour has a solution there is nothing to start from but guesses.
            cold = settings.cold if len(np.unique(owner)) == len(p) else max(settings.cold, _PATIENCE)
        yield Task(chunk, payload, settings, (seed, chunk), p, owner, z, cold)


# -- the run -----------------------------------------------------------------------------------------------------------


class _Pool:
    """Runs tasks on the caller's executor, or on a process pool of its own that it rebuilds when that breaks."""

    def __init__(self, executor: Executor | None, workers: int | None) -> None:
        self._own = executor is None
        self._workers = workers or os.cpu_count() or 1
        self._executor = executor or self._new()
        self.in_flight = 2 * (self._workers if executor is None else _width_of(executor))

    def _new(self) -> Executor:
        # Spawned, not forked: a fork copies threads' locks and the parent's solver child.
        return ProcessPoolExecutor(self._workers, mp_context=get_context("spawn"), initializer=_end_with_parent)

    def submit(self, task: Task) -> Future[Rows]:
        return self._executor.submit(solve_chunk, task)

    def rebuild(self, error: BaseException) -> None:
        """A new pool of our own; a caller's executor that broke stays broken, and ``error`` is raised."""
        if not self._own:
            raise error
        self._executor.shutdown(wait=False, cancel_futures=True)
        self._executor = self._new()

    def close(self) -> None:
        if self._own:
            self._executor.shutdown(wait=True, cancel_futures=True)


def _end_with_parent() -> None:
    """Make this worker end when its parent does; that of a parent that was killed would wait for ever."""
    parent = parent_process()
    if parent is not None:
        Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _width_of(executor: Any) -> int:
    """Tasks that an executor of the caller's can run at once, as far as it tells."""
    client = getattr(executor, "_client", None)  # a Dask cluster
    if client is not None:
        return max(1, sum(client.ncores().values()))
    return getattr(executor, "_max_workers", None) or os.cpu_count() or 1


class _Run:
    """Runs tasks with few in flight, writes each chunk as it comes, and survives workers that die."""

    def __init__(self, database: Database, pool: _Pool, bar: tqdm[Any]) -> None:
        self._database, self._pool, self._bar = database, pool, bar
        self._failed = 0
        self._losses = 0  # since the last chunk that came

    def __call__(self, tasks: Iterator[Task]) -> None:
        running: dict[Future[Rows], Task] = {}
        again: list[Task] = []
        try:
            while True:
                while len(running) < self._pool.in_flight and (task := again.pop() if again else next(tasks, None)):
                    running[self._submit(task)] = task
                if not running:
                    return
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = next((e for f in done if isinstance(e := f.exception(), BrokenExecutor)), None)
                if broken is not None:
                    done, _ = wait(running)  # a broken pool breaks all that it had
                again += [task for future in done if (task := self._take(future, running.pop(future))) is not None]
                if broken is not None:
                    self._pool.rebuild(broken)
        finally:
            for future in running:
                future.cancel()

    def _submit(self, task: Task) -> Future[Rows]:
        try:
            return self._pool.submit(task)
        except BrokenExecutor as error:
            self._lost(error)
            self._pool.rebuild(error)
            return self._pool.submit(task)

    def _take(self, future: Future[Rows], task: Task) -> Task | None:
        """Write the chunk that came; the task itself where its worker was lost."""
        error = future.exception()
        if error is not None:
            self._lost(error)
            return task
        rows = future.result()
        self._database.write(task.chunk, rows)
        self._losses = 0
        self._failed += int((rows.status != Status.SOLVED).sum())
        self._bar.update(len(rows.status))
        self._bar.set_postfix(failed=self._failed)
        return None

    def _lost(self, error: BaseException) -> None:
        """Count a lost worker; raise what is no such loss, and a loss too many."""
        lost = isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"  # the latter is Dask's
        self._losses += 1
        if not lost or self._losses > _RETRIES * self._pool.in_flight:
            raise error


def generate(
    problem: OptimalControlProblem,
    path: str | os.PathLike[str],
    parameters: ArrayLike,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    seed: int = 0,
    settings: GenerationSettings = DEFAULT,
    extrapolate: bool = False,
    progress: bool | None = None,
) -> Database:
    """Solve the problem for every parameter and store the best trajectory of every mode.

    The same call again goes on where an earlier one was interrupted. With the default executor the calling script needs
    Python's usual ``if __name__ == "__main__":``.

    Args:
        problem: what to solve; a problem of your own need not be registered.
        path: folder of the database.
        parameters: (M, np).
        executor: any ``concurrent.futures`` executor, such as a Dask cluster's ``client.get_executor()``; by default a
            pool of processes.
        workers: processes of the default pool; one per core where not given.
        seed: of the order and of the guesses.
        settings: how.
        extrapolate: accept parameters outside the box.
        progress: show a progress bar; by default where standard error is a terminal.

    Raises:
        DatabaseError: the path holds something else, or a database made otherwise.
        ValueError: unusable parameters.
    """
    p = problem.check_parameters(parameters, extrapolate)
    database = _open_or_create(problem, Path(path), p, seed, settings)
    done = database.present()
    if done.all():
        return database
    with GuardedSolver(problem, settings.solver) as solver:
        solver.start()  # compiles, once, before workers ask for it
    begun = database.totals()["problems"]
    hidden = None if progress is None else not progress
    pool = _Pool(executor, workers)
    with tqdm(total=len(p), initial=begun, unit="problem", desc=problem.id, disable=hidden) as bar:
        run = _Run(database, pool, bar)
        try:
            for chunks in _rounds(database, settings):
                run(_tasks(database, settings, seed, chunks))
        finally:
            pool.close()
    return database


def _open_or_create(
    problem: OptimalControlProblem, path: Path, p: Array, seed: int, settings: GenerationSettings
) -> Database:
    record = {"seed": seed, **dataclasses.asdict(settings)}
    if not path.exists():
        order = np.random.default_rng(seed).permutation(len(p))
        return Database.create(path, problem, p, order=order, settings=record, chunk=settings.chunk)
    database = Database.open(path, problem)
    if database.settings != record or not np.array_equal(database.parameters, p):
        raise DatabaseError(
            f"{path} was made with other parameters, settings or seed; remove it or choose another path"
        )
    return database
