"""The guard: solves in a child process that is killed and replaced when a solve hangs or crashes.

An interior-point solver is a C call that nothing can interrupt, and that may loop for ever on a NaN. The child streams
its results one by one, so that every solve is timed. The limit is wall-clock time and generous: it catches hangs only.
What hung the primary solver, or crashed it twice, is solved by the fallback in the new child. A crash is tried twice
because something else may have killed the child, which must leave no trace in the results.
"""

from __future__ import annotations

import statistics
import time
from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from ocp_envs.solvers.channel import Channel, Gone, Silent
from ocp_envs.solvers.child import Child, Factory
from ocp_envs.solvers.nlp import NlpSolver, Result, SolverSettings, Status, Task
from ocp_envs.solvers.transcription import Transcription

#: Tasks sent ahead, so that the child never waits for its parent; few enough to fit into a pipe's buffer.
_AHEAD = 4
#: Solve times kept for the running median.
_KEPT_TIMES = 1000


class Guard:
    """A solver in a child process, started with the first task; not to be shared between threads.

    In the child, ``factory`` makes the solver of the program ``transcription`` with ``settings``.
    """

    def __init__(self, transcription: Transcription, settings: SolverSettings, factory: Factory = NlpSolver) -> None:
        self._transcription, self._settings, self._factory = transcription, settings, factory
        self._child: Child | None = None
        self._times: deque[float] = deque(maxlen=_KEPT_TIMES)
        self.restarts = 0

    @property
    def process_id(self) -> int | None:
        """Id of the child process; ``None`` where there is none."""
        return None if self._child is None else self._child.process_id

    def solve(self, tasks: Sequence[Task]) -> Iterator[Result]:
        """Results in the order of ``tasks``.

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
                except (Silent, Gone) as error:
                    self._replace()
                    if isinstance(error, Gone) and crashed != done:
                        crashed = done  # perhaps killed from outside, which is no fault of the task
                        continue
                    yield self._rescue(tasks[done])
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
        if self._child is None:
            setup = self._factory, self._transcription, self._settings
            try:
                self._child = Child(*setup)
            except RuntimeError:  # perhaps killed from outside
                self._child = Child(*setup)
        return self._child.channel

    def _limit(self) -> float:
        """Seconds after which a solve counts as hung."""
        median = statistics.median(self._times) if self._times else 0.0
        return max(self._settings.hang_floor, self._settings.hang_factor * median)

    def _stream(self, tasks: Sequence[Task], first: int) -> Iterator[Result]:
        channel, limit = self.start(), self._limit()
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
        channel = self.start()
        try:
            channel.send((task, True))
            result: Result = channel.receive(limit)
            return result
        except (Silent, Gone) as error:
            self._replace()
            status = Status.TIMED_OUT if isinstance(error, Silent) else Status.CRASHED
            held = np.full(self._transcription.clearance_rows.shape, np.nan)
            seconds = time.perf_counter() - began
            return Result(status, np.full_like(task.guess, np.nan), np.nan, held, 0, True, seconds)
