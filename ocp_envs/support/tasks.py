"""Many tasks on workers that may die: few are in flight, and each result is taken as it arrives."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from typing import Generic, TypeVar

from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.workers import Workers

Task = TypeVar("Task")
Result = TypeVar("Result")

#: How often each task in flight may lose its worker, while no result arrives, before the loss is an error.
_RETRIES = 3
#: Seconds after which the number of tasks in flight is asked for again, as workers may join and leave.
_LOOK = 5.0
_RESUMES = "every finished chunk is stored, and the same call resumes from there"


@contextlib.contextmanager
def workers_of(executor: Executor | None, count: int | None) -> Iterator[Workers]:
    """The workers of ``executor``, which runs ``count`` tasks at once, or ``count`` new processes for the block.

    Both numbers are by default one for each core.
    """
    if executor is not None:
        yield Workers.of(executor, count)
        return
    pool = WorkerPool(count)
    try:
        yield Workers.of(pool, count)
    finally:
        pool.shutdown(wait=False)


class TaskRun(Generic[Task, Result]):
    """Runs ``call`` for tasks on ``workers``, and passes each task with its result to ``take``, which stores it.

    A task whose worker died runs again. Only the calling thread takes results. Errors that end the run say what is left
    of it, in the words ``resumes``.
    """

    def __init__(
        self,
        call: Callable[[Task], Result],
        workers: Workers,
        take: Callable[[Task, Result], object],
        resumes: str = _RESUMES,
    ) -> None:
        self._call, self._workers, self._take, self._resumes = call, workers, take, resumes
        self._losses = 0  # since the last result arrived

    def __call__(self, tasks: Iterator[Task]) -> None:
        """Run all ``tasks``.

        Raises:
            BrokenExecutor: no task can run any more.
            Exception: what ``call`` or ``take`` raised, or the loss of too many workers.
        """
        running: dict[Future[Result], Task] = {}
        again: list[Task] = []
        try:
            while True:
                in_flight = self._workers.in_flight()
                while len(running) < in_flight and (task := again.pop() if again else next(tasks, None)) is not None:
                    running[self._workers.submit(self._call, task)] = task
                if not running:
                    return
                done, _ = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
                again += [task for future in done if (task := self._taken(future, running.pop(future))) is not None]
        except BrokenExecutor as error:  # the tasks in flight ended with it
            raise BrokenExecutor(f"{error}; {self._resumes}") from error
        except BaseException as error:
            for future in running:
                future.cancel()
            if isinstance(error, KeyboardInterrupt):
                error.add_note(self._resumes)
            raise

    def _taken(self, future: Future[Result], task: Task) -> Task | None:
        """Take the result that arrived; return the task where its worker was lost."""
        error = CancelledError("the executor dropped a task") if future.cancelled() else future.exception()
        if error is not None:
            self._count_loss(error)
            return task
        self._take(task, future.result())
        self._losses = 0
        return None

    def _count_loss(self, error: BaseException) -> None:
        """Count a lost worker; raise any other error, and one loss too many."""
        self._losses += 1
        if not isinstance(error, self._workers.lost) or self._losses > _RETRIES * self._workers.in_flight():
            raise error
