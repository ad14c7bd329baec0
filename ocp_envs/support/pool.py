"""A pool of worker processes, any of which may be killed at any moment: the pool then loses one task and never hangs.

``concurrent.futures.ProcessPoolExecutor`` has one pipe for the results of all workers. A worker killed while it sends
leaves an incomplete result and a locked pipe, and the pool waits for ever; a worker killed at any other moment breaks
the whole pool and loses all tasks in flight. Here every worker has its own pipe, whose other end exists in that worker
alone. Its death therefore ends the pipe, costs only its own task, and another worker replaces it. One thread of this
process communicates with each worker.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import connection, get_context, parent_process, resource_tracker
from types import TracebackType
from typing import ParamSpec, TypeVar, cast

from ocp_envs.support import progress

P = ParamSpec("P")
T = TypeVar("T")

#: Spawned, not forked: a fork copies threads' locks and the parent's solver child.
_SPAWN = get_context("spawn")
#: Time that a process may take to end after its pipe ended, in seconds.
_GRACE = 5.0
#: Processes are started one at a time.
_STARTING = threading.Lock()


#: Modules that every new worker imports.
_IMPORTED: list[str] = []


def import_in_workers(module: str) -> None:
    """Have every worker that starts from now on import ``module``, for what it registers, such as a problem."""
    if module not in _IMPORTED:
        _IMPORTED.append(module)


class WorkerLostError(RuntimeError):
    """The process that ran a task ended before the task."""


class WorkerPool(Executor):
    """An executor whose processes start with their first task.

    A task whose worker dies ends in :class:`WorkerLostError`; the others continue, and later ones get a new worker.

    Args:
        workers: number of processes; by default one per core.

    As a context it ends after its tasks; where the block ends in an exception or an interrupt, it kills them.

    It belongs to the process that made it: in a forked one, :meth:`submit` raises a ``RuntimeError``.

    Raises:
        ValueError: fewer than one worker.
    """

    def __init__(self, workers: int | None = None) -> None:
        if workers is not None and workers < 1:
            raise ValueError(f"got workers={workers}, expected at least 1, or None for one per core")
        self._threads = ThreadPoolExecutor(workers or os.cpu_count() or 1, thread_name_prefix="worker")
        self._own = threading.local()
        self._workers: list[_Worker] = []
        self._closed = False
        self._process = os.getpid()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        if os.getpid() != self._process:  # its threads are not there, and the task would never begin
            raise RuntimeError(
                f"got a task from process {os.getpid()}, expected one from process {self._process}, which made this "
                "pool; make a WorkerPool in each process"
            )
        return cast("Future[T]", self._threads.submit(self._call, (fn, args, kwargs)))

    def _call(self, message: tuple[object, ...]) -> object:
        worker: _Worker | None = getattr(self._own, "worker", None)
        if worker is None:
            worker = self._own.worker = _Worker()
            self._workers.append(worker)
            if self._closed:
                worker.kill()  # after the others
        try:
            return worker.call(message)
        except WorkerLostError:
            self._own.worker = None
            self._workers.remove(worker)
            raise

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.shutdown(wait=kind is None)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes.

        Args:
            wait: after their tasks; otherwise kill them now, and cancel their tasks.
            cancel_futures: drop the tasks that have not begun.
        """
        if os.getpid() != self._process:
            return  # the workers are those of the process that made the pool
        if not wait:
            self._kill()
        self._threads.shutdown(wait=True, cancel_futures=cancel_futures or not wait)
        self._kill()
        for worker in self._workers:
            worker.process.join()

    def _kill(self) -> None:
        self._closed = True
        for worker in list(self._workers):
            worker.kill()


class _Worker:
    """A process and the pipe to it; for one thread."""

    def __init__(self) -> None:
        self._connection, theirs = _SPAWN.Pipe()
        self.process = _SPAWN.Process(target=_serve, args=(theirs, tuple(_IMPORTED)), daemon=True)
        with _STARTING, _interrupts_blocked():
            self.process.start()
        theirs.close()  # now the death of the process ends the pipe

    def call(self, message: tuple[object, ...]) -> object:
        try:
            self._connection.send(message)
            good, value = self._connection.recv()
        except (EOFError, OSError):
            self.process.join(_GRACE)
            self.kill()
            self.process.join()
            self._connection.close()
            raise WorkerLostError(
                f"a worker process ended with exit code {self.process.exitcode} (−9: killed, perhaps for lack of "
                "memory; 1: perhaps the calling script lacks `if __name__ == '__main__':`)"
            ) from None
        if good:
            return value
        raise value

    def kill(self) -> None:
        """End the process; the thread that waits for an answer notices it at the pipe."""
        self.process.kill()


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Processes started in the block get no interrupts from the terminal, not even before they run :func:`_serve`."""
    resource_tracker.ensure_running()  # starting it would unblock them
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: connection.Connection, modules: Sequence[str]) -> None:
    """Import ``modules``, then run the tasks that arrive, until the pipe or the parent ends; what the worker runs."""
    # Only the parent reacts to an interrupt at the terminal: no task may be broken off.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    progress.show(False)  # the parent shows how many tasks are done
    parent = parent_process()
    assert parent is not None
    threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()
    for module in modules:
        importlib.import_module(module)
    while True:
        try:
            task = pipe.recv_bytes()
        except (EOFError, OSError):
            return
        try:
            fn, args, kwargs = pickle.loads(task)
            answer = True, fn(*args, **kwargs)
        except Exception as error:
            error.add_note(f"in a worker process:\n{traceback.format_exc()}")
            answer = False, error
        try:
            pipe.send(answer)
        except OSError:
            return
        except Exception as error:  # the answer cannot be pickled
            pipe.send((False, TypeError(f"{answer[1]!r} cannot leave its worker process: {error}")))


def _exit_after(sentinel: int) -> None:
    """End this process when the one of ``sentinel`` ends, also during a task."""
    connection.wait([sentinel])
    os._exit(1)
