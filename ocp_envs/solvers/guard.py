"""The guard: solves in a child process that is killed and replaced when a solve hangs or crashes.

An interior-point solver is a C call that nothing can interrupt, and that may loop for ever: fatrop does so where no
multiple of the identity makes its matrix positive definite. What hung the primary solver, or crashed it twice, is
solved by the fallback in the new child, if the task says so. A crash is tried twice because something else may have
killed the child, which must leave no trace in the results.

Limits are seconds of the child's processor time, so that results do not depend on what else the machine does. Iteration
limits decide how every solve ends that ends by itself; the limits are at least ten times what such solves take and
catch hangs only. The child streams its results one by one, so that the limits can follow the median solve. A limit of
wall-clock time, far above, is for a child that does nothing at all.
"""

from __future__ import annotations

import os
import statistics
import time
from collections import deque
from collections.abc import Iterator, Sequence

from ocp_envs.solvers.channel import Channel, Gone, Silent
from ocp_envs.solvers.child import Child, Factory
from ocp_envs.solvers.cpu_limit import Limits
from ocp_envs.solvers.nlp import Result, SolverSettings, Status, Task
from ocp_envs.solvers.nlp_solver import NlpSolver
from ocp_envs.solvers.transcription import Transcription

#: Tasks sent ahead, so that the child never waits for its parent; few enough to fit into a pipe's buffer.
_AHEAD = 4
#: Solve times kept for the running median.
_KEPT_TIMES = 1000
#: The least limit while no solve time is known, seconds of processor time.
UNKNOWN_LIMIT = 5.0
#: The fallback solver, whose functions are interpreted, may take this many times as long. It is not known to hang.
FALLBACK_FACTOR = 10.0
#: Seconds of wall-clock time for each second of processor time.
WALL_FACTOR = 4.0


class Guard:
    """A solver in a child process, started with the first task; for one thread at a time.

    In the child, ``factory`` makes the solver of the program ``transcription`` with ``settings``. Copies, and this
    object in a forked process, start children of their own.
    """

    def __init__(self, transcription: Transcription, settings: SolverSettings, factory: Factory = NlpSolver) -> None:
        self._transcription, self._settings, self._factory = transcription, settings, factory
        self._child: Child | None = None
        self._times: deque[float] = deque(maxlen=_KEPT_TIMES)
        self.restarts = 0

    def __reduce__(self) -> tuple[object, ...]:
        return Guard, (self._transcription, self._settings, self._factory)

    @property
    def process_id(self) -> int | None:
        """Id of the child process; ``None`` where there is none."""
        return None if self._child is None else self._child.process_id

    def solve(self, tasks: Sequence[Task]) -> Iterator[Result]:
        """Results in the order of ``tasks``.

        Raises:
            RuntimeError: the child cannot be started.
        """
        done, failed = 0, -1
        try:
            while done < len(tasks):
                began = time.perf_counter()
                try:
                    for result in self._stream(tasks, done):
                        done += 1
                        yield result
                        began = time.perf_counter()
                except (Silent, Gone) as error:
                    used_up = self._replace()
                    if not used_up and failed != done:
                        failed = done  # perhaps killed or stopped from outside, which is no fault of the task
                        continue
                    yield self._rescue(tasks[done], _status(error, used_up), began)
                    done += 1
        finally:
            if done < len(tasks):
                self.close()  # interrupted: pending answers would be taken for those of later tasks

    def close(self) -> None:
        """End the child; the next task starts another."""
        if self._child is not None:
            self._child.kill()
            self._child = None

    def start(self) -> Channel:
        """The channel to the child, which is started unless it runs."""
        if self._child is None or self._child.parent != os.getpid():  # a fork's answers would reach either process
            setup = self._factory, self._transcription, self._settings
            try:
                self._child = Child(*setup)
            except RuntimeError:  # perhaps killed from outside
                self._child = Child(*setup)
        return self._child.channel

    def _limits(self) -> Limits:
        """The limits of one solve."""
        settings, median = self._settings, statistics.median(self._times) if self._times else 0.0
        least = settings.hang_floor if self._times else max(settings.hang_floor, UNKNOWN_LIMIT)
        limit = max(least, settings.hang_factor * median)
        return Limits(limit, FALLBACK_FACTOR * max(limit, UNKNOWN_LIMIT))

    def _stream(self, tasks: Sequence[Task], first: int) -> Iterator[Result]:
        channel, limits = self.start(), self._limits()
        sent = first
        for _ in range(first, len(tasks)):
            while sent < min(first + _AHEAD, len(tasks)):
                channel.send((tasks[sent], False, limits))
                sent += 1
            result = channel.receive(WALL_FACTOR * sum(limits))
            first += 1
            self._times.append(result.seconds)
            yield result

    def _replace(self) -> bool:
        """Replace the child; whether it had used up its processor time."""
        assert self._child is not None
        used_up = self._child.used_up()
        self.close()
        self.restarts += 1
        self.start()
        return used_up

    def _rescue(self, task: Task, status: Status, began: float) -> Result:
        """The fallback, if ``task`` wants it, after the primary solver ended with ``status``; it ``began`` then."""
        if task.rescue:
            channel, limits = self.start(), self._limits()
            try:
                channel.send((task, True, limits))
                result: Result = channel.receive(WALL_FACTOR * limits.fallback)
                return result
            except (Silent, Gone) as error:
                status = _status(error, self._replace())
        seconds = time.perf_counter() - began
        return Result.failed(status, self._transcription, task.rescue, seconds)


def _status(error: Exception, used_up: bool) -> Status:
    """How a solve ended whose child was lost with ``error``, perhaps because it ``used_up`` its processor time."""
    return Status.TIMED_OUT if used_up or isinstance(error, Silent) else Status.CRASHED
