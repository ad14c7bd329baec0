"""The guard: solves in a child process that is killed and replaced when a solve hangs or crashes.

An interior-point solver is a C call that nothing can interrupt, and that may loop for ever on a NaN. The child is
started with ``subprocess`` (worker processes of a pool may not start ``multiprocessing`` children), runs one BLAS
thread and speaks length-prefixed pickles over its standard input and output; both ends are our own processes. It
streams results one by one, so that every single solve is timed. The limit is wall-clock time and generous: it catches
hangs only. What hung the primary solver, or crashed it twice, goes to the fallback in the new child: a child that
somebody killed once leaves no trace in the results.

The child ends when its standard input ends, so also when its parent is killed.
"""

from __future__ import annotations

import os
import pickle
import queue
import select
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import warnings
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, BinaryIO, Protocol

import numpy as np

from ocp_envs.solvers.nlp import NlpSolver, Result, SolverSettings, Status, Task
from ocp_envs.solvers.transcription import Transcription

#: Tasks sent ahead, so that the child never waits for its parent; few enough to fit into a pipe's buffer.
_AHEAD = 4
#: Solve times kept for the running median.
_KEPT_TIMES = 1000
#: Seconds after which a child ends by itself: one that hangs in C may not see that its parent was killed.
_ALONE_LIMIT = 900
#: Seconds a child may take to start: imports, and a compilation of the solver functions at worst.
_START_LIMIT = 900.0
_HEADER = struct.Struct("<Q")


class TaskSolver(Protocol):
    """What runs in the child."""

    def solve(self, task: Task, skip_primary: bool = False) -> Result:
        """Solve one task."""


#: Makes the solver of the child, in the child; pickled by reference.
Factory = Callable[[Transcription, SolverSettings], TaskSolver]


class _Silent(Exception):
    """Nothing came within the limit."""


class _Gone(Exception):
    """The other end is closed."""


class _Channel:
    """Pickles with their length in front, over two file descriptors."""

    def __init__(self, source: int, sink: int) -> None:
        self._source, self._sink, self._pending = source, sink, bytearray()

    def send(self, message: Any) -> None:
        body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
        data = memoryview(_HEADER.pack(len(body)) + body)
        try:
            while data:
                data = data[os.write(self._sink, data) :]
        except OSError as error:
            raise _Gone from error

    def receive(self, limit: float | None = None) -> Any:
        """The next message; ``limit`` in seconds."""
        deadline = None if limit is None else time.monotonic() + limit
        size = _HEADER.unpack(self._take(_HEADER.size, deadline))[0]
        return pickle.loads(self._take(size, deadline))

    def _take(self, size: int, deadline: float | None) -> bytes:
        while len(self._pending) < size:
            if deadline is not None:
                left = max(0.0, deadline - time.monotonic())
                if not select.select([self._source], [], [], left)[0]:
                    raise _Silent
            data = os.read(self._source, 1 << 16)
            if not data:
                raise _Gone
            self._pending += data
        taken = bytes(self._pending[:size])
        del self._pending[:size]
        return taken


class Guard:
    """A solver in a child process. Started with the first task; not to be shared between threads.

    Args:
        transcription: the program.
        settings: its ``hang_factor`` and ``hang_floor`` give the limit.
        factory: what makes the solver in the child.
    """

    def __init__(self, transcription: Transcription, settings: SolverSettings, factory: Factory = NlpSolver) -> None:
        self._transcription, self._settings, self._factory = transcription, settings, factory
        self._child: _Child | None = None
        self._times: deque[float] = deque(maxlen=_KEPT_TIMES)
        self.restarts = 0

    @property
    def process_id(self) -> int | None:
        """Id of the child process; ``None`` where there is none."""
        return None if self._child is None else self._child.process_id

    def solve(self, tasks: Sequence[Task]) -> Iterator[Result]:
        """Results in the order of the tasks.

        Raises:
            RuntimeError: the child cannot be started.
        """
        done, crashed = 0, -1
        try:
            while done < len(tasks):
                try:
                    for result in self._stream(tasks, done):
                        done += 1
                        yield result
                except (_Silent, _Gone) as error:
                    self._replace()
                    if isinstance(error, _Gone) and crashed != done:
                        crashed = done  # perhaps killed from outside: what is no fault of the task must not show
                        continue
                    yield self._rescue(tasks[done])
                    done += 1
        finally:
            if done < len(tasks):
                self.close()  # interrupted: answers still to come would be taken for those of later tasks

    def close(self) -> None:
        """End the child; the next task starts another."""
        if self._child is not None:
            self._child.kill()
            self._child = None

    def start(self) -> None:
        """Start the child now rather than with the first task."""
        if self._child is None:
            setup = self._factory, self._transcription, self._settings
            try:
                self._child = _Child(setup)
            except RuntimeError:  # perhaps killed from outside
                self._child = _Child(setup)

    def _channel(self) -> _Channel:
        self.start()
        assert self._child is not None
        return self._child.channel

    def _limit(self) -> float:
        """Seconds after which a solve counts as hung."""
        median = statistics.median(self._times) if self._times else 0.0
        return max(self._settings.hang_floor, self._settings.hang_factor * median)

    def _stream(self, tasks: Sequence[Task], first: int) -> Iterator[Result]:
        channel, limit = self._channel(), self._limit()
        sent = first
        for _ in range(first, len(tasks)):
            while sent < min(first + _AHEAD, len(tasks)):
                channel.send((tasks[sent], False))
                sent += 1
            result = channel.receive(limit)
            first += 1
            self._times.append(result.seconds)
            yield result

    def _replace(self) -> None:
        self.close()
        self.restarts += 1
        self.start()

    def _rescue(self, task: Task) -> Result:
        """The fallback, for a task that hung or crashed the primary solver."""
        began, limit = time.perf_counter(), self._limit()
        channel = self._channel()
        try:
            channel.send((task, True))
            result: Result = channel.receive(limit)
            return result
        except (_Silent, _Gone) as error:
            self._replace()
            status = Status.TIMED_OUT if isinstance(error, _Silent) else Status.CRASHED
            held = np.full(self._transcription.clearance_rows.shape, np.nan)
            seconds = time.perf_counter() - began
            return Result(status, np.full_like(task.guess, np.nan), np.nan, held, 0, True, seconds)


class _Child:
    """The process and the channel to it; ends with ``kill``, with this object or with the interpreter."""

    def __init__(self, setup: tuple[Factory, Transcription, SolverSettings]) -> None:
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)  # the factory must be importable there too
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", "from ocp_envs.solvers.guard import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env={**os.environ, **threads, "PYTHONPATH": path},
        )
        self.process_id = process.pid
        self.kill = weakref.finalize(self, _end, process, errors)
        assert process.stdin is not None
        assert process.stdout is not None
        self.channel = _Channel(process.stdout.fileno(), process.stdin.fileno())
        try:
            self.channel.send(setup)
            for message in self.channel.receive(_START_LIMIT):
                warnings.warn(message, stacklevel=2)
        except (_Silent, _Gone):
            process.kill()
            process.wait()
            errors.seek(0)
            message = errors.read().decode(errors="replace").strip()
            self.kill()
            raise RuntimeError(f"the solver process did not start:\n{message}") from None


def _end(process: subprocess.Popen[bytes], errors: BinaryIO) -> None:
    process.kill()
    process.wait()
    for file in (process.stdin, process.stdout, errors):
        if file is not None:
            file.close()


def serve() -> None:
    """The child: solves what comes in, until its standard input ends."""
    channel = _Channel(os.dup(0), os.dup(1))
    os.dup2(2, 1)  # what a solver prints must not get between the messages
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    factory, transcription, settings = channel.receive()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solver = factory(transcription, settings)
    tasks: queue.SimpleQueue[tuple[Task, bool]] = queue.SimpleQueue()

    def read() -> None:
        try:
            while True:
                tasks.put(channel.receive())
        except _Gone:
            os._exit(0)  # the parent is gone; the main thread may be inside a solve that never ends

    channel.send([warning.message for warning in caught])
    threading.Thread(target=read, daemon=True).start()
    while True:
        task, skip_primary = tasks.get()
        signal.alarm(_ALONE_LIMIT)
        result = solver.solve(task, skip_primary)
        signal.alarm(0)
        channel.send(result)
