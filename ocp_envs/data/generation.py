"""Generation of databases: multistart on a first subset, then warm starts from neighbours, in rounds.

Problems are put into a random order and solved in rounds of n₀, 2n₀, 4n₀ … problems. In the first round every winding
of the goal is tried from several guesses. In a later round a problem looks at its nearest neighbours among the problems
of *earlier* rounds, takes from them the modes that are best or nearly best there, and starts each from the solutions of
the nearest neighbours that have it (Tang & Hauser, section III-B, after Tang, Sun & Hauser's nearest-neighbour method).
So what is solved depends on the problem, the settings and the seed alone, and not on the number of workers or on
interruptions.

A task is a chunk of problems with their guesses. Only the calling process writes, and only one at a time may; a killed
worker costs its chunk, a killed parent the chunks in flight, and the same call again goes on from there.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import time
import warnings
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import ArrayLike
from tqdm import tqdm

from ocp_envs.data.database import Database, DatabaseError, Rows
from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.data.warm_starts import rounds, tasks
from ocp_envs.data.worker import Chunk, solve_chunk
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.pool import WorkerLostError, WorkerPool

#: Times each task in flight may lose its worker, without any chunk coming in between, before that is an error.
_RETRIES = 3
#: Seconds between looks at a cluster's size: workers may join and leave, and the scheduler may go.
_LOOK = 5.0


class _Pool:
    """Runs tasks in worker processes of its own, or on the caller's executor."""

    def __init__(self, executor: Executor | None, workers: int | None) -> None:
        self._own = WorkerPool(workers) if executor is None else None
        self._executor: Any = executor or self._own
        dask = type(executor).__module__.partition(".")[0] == "distributed"
        self._client: Any = getattr(executor, "_client", None) if dask else None
        self._scheduler = self._client.scheduler.address if self._client and self._client.scheduler else ""
        self._width = workers if executor is None else getattr(executor, "_max_workers", None)
        self._looked = -np.inf

    def submit(self, task: Chunk) -> Future[Rows]:
        if self._client is None:
            return self._executor.submit(solve_chunk, task)
        # Dask would give a task that it has seen the result it had, also where that is the loss of its workers.
        return self._executor.submit(solve_chunk, task, pure=False)

    @property
    def in_flight(self) -> int:
        """How many tasks to have submitted: two for each that can run at once, as far as the executor tells."""
        if self._client is not None and time.monotonic() - self._looked >= _LOOK:
            self._width = self._cluster_width()
            self._looked = time.monotonic()
        return 2 * max(1, self._width or os.cpu_count() or 1)

    def _cluster_width(self) -> int:
        """Threads of a Dask cluster."""
        if self._client.status == "closed":
            raise BrokenExecutor(
                f"the Dask scheduler {self._scheduler} is gone, or its client was closed; all chunks that came are "
                "stored, and the same call goes on from there"
            )
        try:
            width = sum(self._client.ncores().values())
        except (OSError, TimeoutError):  # it is reconnecting, and closes itself where that fails
            return self._width or 1
        if not width:
            warnings.warn("the Dask cluster has no workers; waiting for some to join", stacklevel=2)
        return max(1, width)

    def cancel(self, futures: Iterable[Future[Rows]]) -> None:
        if self._client is None or self._client.status != "closed":  # a closed client complains
            for future in futures:
                future.cancel()

    def close(self) -> None:
        if self._own is not None:
            self._own.shutdown(wait=False)


class _Run:
    """Runs tasks with few in flight, writes each chunk as it comes, and survives workers that die."""

    def __init__(self, database: Database, pool: _Pool, bar: tqdm[Any]) -> None:
        self._database, self._pool, self._bar = database, pool, bar
        self._failed = 0
        self._losses = 0  # since the last chunk that came

    def __call__(self, tasks: Iterator[Chunk]) -> None:
        running: dict[Future[Rows], Chunk] = {}
        again: list[Chunk] = []
        try:
            while True:
                in_flight = self._pool.in_flight
                while len(running) < in_flight and (task := again.pop() if again else next(tasks, None)):
                    running[self._pool.submit(task)] = task
                if not running:
                    return
                done, _ = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
                again += [task for future in done if (task := self._take(future, running.pop(future))) is not None]
        finally:
            self._pool.cancel(running)

    def _take(self, future: Future[Rows], task: Chunk) -> Chunk | None:
        """Write the chunk that came; the task itself where its worker was lost."""
        error = CancelledError("the executor dropped a task") if future.cancelled() else future.exception()
        if error is not None:
            self._lost(error)
            return task
        rows = future.result()
        self._database.write(task.number, rows)
        self._losses = 0
        self._failed += int((rows.status != Status.SOLVED).sum())
        self._bar.update(len(rows.status))
        self._bar.set_postfix(failed=self._failed)
        return None

    def _lost(self, error: BaseException) -> None:
        """Count a lost worker; raise what is no such loss, and a loss too many."""
        # Dask's name for a task whose workers died, several one after another; it cancels tasks when it is restarted.
        lost = isinstance(error, WorkerLostError | CancelledError) or type(error).__name__ == "KilledWorker"
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
    settings: GenerationSettings = DEFAULT_GENERATION,
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
            pool of processes. One that breaks stays broken: its error is raised, and what came is stored.
        workers: processes of the default pool; one per core where not given.
        seed: of the order and of the guesses.
        settings: how.
        extrapolate: accept parameters outside the box.
        progress: show a progress bar; by default where standard error is a terminal.

    Raises:
        DatabaseError: the path holds something else, or a database made otherwise, or another process is writing it.
        ValueError: unusable parameters.
    """
    p, folder = problem.check_parameters(parameters, extrapolate), Path(path)
    if folder.exists() and (finished := _open_or_create(problem, folder, p, seed, settings)).complete:
        return finished
    with _only_writer(folder):
        database = _open_or_create(problem, folder, p, seed, settings)
        with GuardedSolver(problem, settings.solver) as solver:
            solver.start()  # compiles, once, before workers ask for it
        begun = database.totals()["problems"]
        hidden = None if progress is None else not progress
        pool = _Pool(executor, workers)
        with tqdm(total=len(p), initial=begun, unit="problem", desc=problem.id, disable=hidden) as bar:
            run = _Run(database, pool, bar)
            try:
                for chunks in rounds(database, settings):
                    run(tasks(database, settings, seed, chunks))
            finally:
                pool.close()
    return database


@contextlib.contextmanager
def _only_writer(path: Path) -> Iterator[None]:
    """Keeps other processes from writing to ``path``. The operating system lifts the lock when this one ends."""
    target = path.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(f"{target}.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise DatabaseError(
            f"{path} is being generated by another process; wait for it to end, or choose another path"
        ) from None
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
    record = {"seed": seed, **settings.record()}
    if not path.exists():
        order = np.random.default_rng(seed).permutation(len(p))
        return Database.create(path, problem, p, order=order, settings=record, chunk=settings.chunk)
    database = Database.open(path, problem)
    if database.settings != record or not np.array_equal(database.parameters, p):
        raise DatabaseError(
            f"{path} was made with other parameters, settings or seed; remove it or choose another path"
        )
    return database
