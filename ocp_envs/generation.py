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
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from ocp_envs.chunks import DEFAULT, GenerationSettings, Task, solve_chunk
from ocp_envs.database import Database, DatabaseError, Rows
from ocp_envs.nlp import Status
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.rounds import rounds, tasks
from ocp_envs.solver import GuardedSolver
from ocp_envs.system import Array

__all__ = ["DEFAULT", "GenerationSettings", "generate"]

#: Times each task in flight may lose its worker, without any chunk coming in between, before that is an error.
_RETRIES = 3


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
            for chunks in rounds(database, settings):
                run(tasks(database, settings, seed, chunks))
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
