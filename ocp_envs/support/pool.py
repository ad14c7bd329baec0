"""Worker processes any of which may be killed at any moment: a pool that loses a task then, and never hangs.

``concurrent.futures.ProcessPoolExecutor`` has one pipe for the results of all workers. A worker that is killed in the
middle of sending leaves half a result and a locked pipe behind, and the pool waits for the rest for ever; one killed at
any other moment takes the whole pool and all tasks in flight with it. Here every worker has a pipe of its own whose
other end lives in that worker alone, so its death ends what is being read, costs its own task, and is mended by another
worker. A thread of this process speaks for each worker.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import connection, get_context, parent_process
from typing import Any

#: Spawned, not forked: a fork copies threads' locks and the parent's solver child.
_SPAWN = get_context("spawn")
#: Seconds that a process whose pipe ended may take to end too.
_GRACE = 5.0
#: Processes are started one at a time.
_STARTING = threading.Lock()


class WorkerLostError(RuntimeError):
    """The process that was to do a task ended before it had."""


class WorkerPool(Executor):
    """An executor with ``workers`` processes (one per core by default), started with their first task.

    A task whose worker dies ends in :class:`WorkerLostError`; the other tasks go on, and later ones get a new worker.
    """

    def __init__(self, workers: int | None = None) -> None:
        self._threads = ThreadPoolExecutor(workers or os.cpu_count() or 1, thread_name_prefix="worker")
        self._own = threading.local()
        self._workers: list[_Worker] = []
        self._closed = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._threads.submit(self._call, fn, args, kwargs)

    def _call(self, *message: Any) -> Any:
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

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: after their tasks, or at once and without them where ``wait`` is false."""
        if not wait:
            self._kill()
        self._threads.shutdown(wait=True, cancel_futures=cancel_futures or not wait)
        self._kill()
        for worker in self._workers:
            worker.join()

    def _kill(self) -> None:
        self._closed = True
        for worker in list(self._workers):
            worker.kill()


class _Worker:
    """A process and the pipe to it; for one thread."""

    def __init__(self) -> None:
        self._connection, theirs = _SPAWN.Pipe()
        self._process = _SPAWN.Process(target=_serve, args=(theirs,), daemon=True)
        with _STARTING:
            self._process.start()
        theirs.close()  # now the death of the process ends the pipe

    def call(self, message: tuple[Any, ...]) -> Any:
        try:
            self._connection.send(message)
            good, value = self._connection.recv()
        except (EOFError, OSError):
            self._process.join(_GRACE)
            self.kill()
            self.join()
            self._connection.close()
            raise WorkerLostError(
                f"a worker process ended with exit code {self._process.exitcode} (−9: killed, perhaps for lack of "
                "memory; 1: perhaps the calling script lacks `if __name__ == '__main__':`)"
            ) from None
        if good:
            return value
        raise value

    def kill(self) -> None:
        """The thread that waits for an answer learns of it through the pipe."""
        self._process.kill()

    def join(self) -> None:
        self._process.join()


def _serve(pipe: connection.Connection) -> None:
    """The worker: does what comes in, until the pipe or its parent ends."""
    # The parent alone decides what an interrupt at the terminal means: no half-solved chunk may come from one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None
    threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()
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
        except Exception as error:  # what cannot be pickled
            pipe.send((False, TypeError(f"{answer[1]!r} cannot leave its worker process: {error}")))


def _exit_after(sentinel: int) -> None:
    """End this process with the one of ``sentinel``, also in the middle of a task."""
    connection.wait([sentinel])
    os._exit(1)
