"""Generation of databases: multistart on a first subset, then warm starts from neighbours, in rounds.

The instances are put into a random order and solved in rounds of n₀, 2n₀, 4n₀ … instances. The first round tries every
winding of the goal from several guesses. In a later round each instance considers its nearest neighbours among the
instances of *earlier* rounds, takes from them the solution families that have the lowest or nearly the lowest cost
there, and starts each family from the solutions of the nearest neighbours that have it (Tang & Hauser, section III-B,
after Tang, Sun & Hauser's nearest-neighbour method). The result therefore depends on the instance, the settings and the
seed alone, and not on the number of workers or on interruptions.

A task is a chunk of instances with their guesses. Only the calling process writes, and only one process at a time may.
A killed worker costs its chunk, a killed parent the chunks in flight; the same call resumes from there.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import ArrayLike

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError, StoredRows
from ocp_envs.data.rounds import rounds, tasks
from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.data.worker import Chunk, solve_chunk
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import Progress
from ocp_envs.support.workers import Workers

#: How often each task in flight may lose its worker, while no chunk arrives, before the loss is an error.
_RETRIES = 3
#: Seconds after which the number of tasks in flight is asked for again, as workers may join and leave.
_LOOK = 5.0


@contextlib.contextmanager
def _workers(executor: Executor | None, count: int | None) -> Iterator[Workers]:
    """The workers of ``executor``, or new processes for the duration of the block."""
    if executor is not None:
        yield Workers.of(executor, count)
        return
    pool = WorkerPool(count)
    try:
        yield Workers.of(pool, count)
    finally:
        pool.shutdown(wait=False)


class _Run:
    """Runs tasks with few in flight, writes each chunk as it arrives, and survives workers that die."""

    def __init__(self, database: Database, workers: Workers, bar: Progress) -> None:
        self._database, self._workers, self._bar = database, workers, bar
        self._failed = 0
        self._losses = 0  # since the last chunk arrived

    def __call__(self, tasks: Iterator[Chunk]) -> None:
        running: dict[Future[StoredRows], Chunk] = {}
        again: list[Chunk] = []
        try:
            while True:
                in_flight = self._workers.in_flight()
                while len(running) < in_flight and (task := again.pop() if again else next(tasks, None)):
                    running[self._workers.submit(solve_chunk, task)] = task
                if not running:
                    return
                done, _ = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
                again += [task for future in done if (task := self._take(future, running.pop(future))) is not None]
        except BrokenExecutor as error:  # the tasks in flight ended with it
            message = f"{error}; every finished chunk is stored, and the same call resumes from there"
            raise BrokenExecutor(message) from error
        except BaseException as error:
            for future in running:
                future.cancel()
            if isinstance(error, KeyboardInterrupt):
                error.add_note("every finished chunk is stored; the same call resumes from there")
            raise

    def _take(self, future: Future[StoredRows], task: Chunk) -> Chunk | None:
        """Write the chunk that arrived; return the task where its worker was lost."""
        error = CancelledError("the executor dropped a task") if future.cancelled() else future.exception()
        if error is not None:
            self._count_loss(error)
            return task
        rows = future.result()
        self._database.write(task.number, rows)
        self._losses = 0
        self._failed += int((rows.status != Status.SOLVED).sum())
        self._bar.update(len(rows.status), failed=self._failed)
        return None

    def _count_loss(self, error: BaseException) -> None:
        """Count a lost worker; raise any other error, and one loss too many."""
        self._losses += 1
        if not isinstance(error, self._workers.lost) or self._losses > _RETRIES * self._workers.in_flight():
            raise error


@checked
def generate(
    problem: ProblemOrId,
    path: str | os.PathLike[str],
    parameters: ArrayLike,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    seed: int = 0,
    settings: GenerationSettings = DEFAULT_GENERATION,
    extrapolate: bool = False,
    progress: bool | None = None,
) -> Database:
    """Solve the problem for all parameters and store the best trajectory of every solution family.

    The same call resumes where an earlier one was interrupted. A call whose parameters begin with those of a finished
    database, in the same order, adds the others: only these are solved, and what is stored of the first stays equal bit
    by bit. Rounds and chunks stay where they are, so a database that grew at a multiple of ``settings.chunk`` equals
    one that was generated at once in its order of rows. It differs from one that :func:`generate` makes at once, which
    puts all instances into random order. What it holds depends on the sizes to which it grew, the settings and the
    seed, and not on interruptions or workers. With the default executor the calling script needs
    Python's usual ``if __name__ == "__main__":``.

    Args:
        problem: what to solve; it need not be registered.
        path: folder of the database.
        parameters: (M, np); the first of them may be stored already. Those that whole turns of angles bring into the
            box are solved and stored there.
        executor: any ``concurrent.futures`` executor, such as a Dask cluster's ``client.get_executor()``; by default a
            pool of processes. If it breaks, its error is raised and every finished chunk is stored.
        workers: processes of the default pool, or tasks that ``executor`` runs at once; one per core where not given.
            A Dask cluster is asked for its threads instead.
        seed: of the order and of the guesses.
        settings: how many guesses and warm starts are tried, and how.
        extrapolate: accept parameters outside the box.
        progress: show it, as a bar on a terminal and elsewhere as a line a minute; by default on a terminal alone.

    Returns:
        the finished database.

    Raises:
        DatabaseError: the path holds something else, or a database made with other arguments, or another process is
            writing it.
        ValueError: parameters of the wrong shape, not finite, or outside the box.
    """
    problem = problem_of(problem)
    p, folder = problem.check_parameters(parameters, extrapolate), Path(path)
    outside = ~problem.parameters.contains(p)
    p[outside] = problem.in_one_turn(p[outside])[0]
    if folder.exists() and _complete(found := _open_or_create(problem, folder, p, seed, settings), p):
        return found
    with _only_writer(folder):
        database = _open_or_create(problem, folder, p, seed, settings)
        with GuardedSolver(problem, settings.solver) as solver:
            solver.start()  # compiles, once, before workers ask for it
        begun = database.totals()["problems"]
        bar = Progress(len(p), unit="instance", label=problem.id, initial=begun, shown=progress)
        with bar, _workers(executor, workers) as pool:
            _finish(database, settings, seed, pool, bar)
            if not _complete(database, p):
                database = _grown(database, p, seed)
                _finish(database, settings, seed, pool, bar)
    return database


def _complete(database: Database, p: Array) -> bool:
    """Whether ``database`` has all of the parameters ``p``, of which it has the first, and their solutions."""
    return len(database) == len(p) and database.complete


def _finish(database: Database, settings: GenerationSettings, seed: int, workers: Workers, bar: Progress) -> None:
    """Solve what is missing, round by round."""
    run = _Run(database, workers, bar)
    for chunks in rounds(database, settings):
        run(tasks(database, settings, seed, chunks))


def _grown(database: Database, p: Array, seed: int) -> Database:
    """The finished ``database`` with rows for those of ``p`` that it does not have."""
    known = len(database)
    order = known + np.random.default_rng((seed, known)).permutation(len(p) - known)
    return database.grow(p[known:], order)


@contextlib.contextmanager
def _only_writer(path: Path) -> Iterator[None]:
    """Keeps other processes from writing to ``path``. The operating system lifts the lock when this process ends."""
    target = path.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(f"{target}.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        message = f"{path} is being generated by another process; wait for it to end, or choose another path"
        raise DatabaseError(message) from None
    try:
        for left in target.parent.glob(f".{target.name}.*"):
            if left.name.removeprefix(f".{target.name}.").isdigit():  # begun by a process that was killed
                shutil.rmtree(left, ignore_errors=True)
        yield
    finally:
        lock.release()


def _open_or_create(
    problem: OptimalControlProblem, path: Path, p: Array, seed: int, settings: GenerationSettings
) -> Database:
    """The database at ``path`` for the parameters ``p`` or the first of them; a new one where there is none."""
    record = {"seed": seed, **settings.record()}
    if not path.exists():
        order = np.random.default_rng(seed).permutation(len(p))
        Database.create(path, problem, p, order=order, settings=record, chunk=settings.chunk)
    database = Database.open(path, problem)
    known = database.parameters
    if database.settings == record and len(known) > len(p) and np.array_equal(known[: len(p)], p):
        raise DatabaseError(
            f"{path} holds {len(known)} instances, of which the given {len(p)} are the first; pass all of them, or "
            f"open it and select, as in Database.open(path).samples(range({len(p)}))"
        )
    if database.settings != record or not np.array_equal(known, p[: len(known)]):
        raise DatabaseError(
            f"{path} was made with other parameters, settings or seed; remove it, or choose another. A database grows "
            f"where the parameters begin with the {len(known)} that it was made with, in the same order"
        )
    return database
