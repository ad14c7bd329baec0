"""The child process of a guard: one solver that solves what it is sent.

It is started with ``subprocess`` (worker processes of a pool may not start ``multiprocessing`` children), runs one BLAS
thread and exchanges messages over its standard input and output. It ends when its standard input ends, so also when its
parent is killed.
"""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
import weakref
from collections.abc import Callable
from typing import BinaryIO, Protocol

from ocp_envs.solvers import cpu_limit
from ocp_envs.solvers.channel import Channel, Gone, Silent
from ocp_envs.solvers.cpu_limit import Limits
from ocp_envs.solvers.nlp import Result, SolverSettings, Task
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.libraries import cure

#: Seconds after which a child that solves ends by itself: inside a C call it cannot see that its parent was killed.
_ALONE_LIMIT = 900
#: Seconds a child may take to start: imports, and at worst a compilation of the solver functions.
_START_LIMIT = 900.0
#: Seconds that the process of a closed pipe may take to end.
_GRACE = 5.0
#: Last lines of what a process printed that an error message quotes.
_QUOTED = 20


class TaskSolver(Protocol):
    """What solves in the child."""

    def solve(self, task: Task, skip_primary: bool = False) -> Result:
        """Solve ``task``; with the fallback solver at once where ``skip_primary``."""


#: Makes the solver of the child, in the child; pickled by reference.
Factory = Callable[[Transcription, SolverSettings], TaskSolver]


class Child:
    """The process and the channel to it; ends with ``kill``, with this object or with the interpreter.

    In the process, ``factory`` makes the solver of the program ``transcription`` with ``settings``.

    Raises:
        RuntimeError: the process ended before it was ready, or took too long; the message says how it ended, what it
            printed last, and what may help.
    """

    def __init__(self, factory: Factory, transcription: Transcription, settings: SolverSettings) -> None:
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        process = _start(errors)
        self._process, self.process_id, self.parent = process, process.pid, os.getpid()
        self.kill = weakref.finalize(self, _end, process, errors, self.parent)
        assert process.stdin is not None
        assert process.stdout is not None
        self.channel = Channel(process.stdout.fileno(), process.stdin.fileno())
        try:
            self.channel.send((factory, transcription, settings))
            for message in self.channel.receive(_START_LIMIT):
                warnings.warn(message, stacklevel=2)
        except (Silent, Gone) as error:
            code = None if isinstance(error, Silent) else self._exit_code()
            process.kill()
            process.wait()
            errors.seek(0)
            printed = errors.read().decode(errors="replace")
            self.kill()
            raise RuntimeError(_why_not_started(code, printed)) from None

    def used_up(self) -> bool:
        """Whether the process has ended because it used up its processor time."""
        return self._exit_code() == -cpu_limit.SIGNAL

    def _exit_code(self) -> int | None:
        """Exit code of the process, which ends now; ``None`` if it does not."""
        try:
            return self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            return None


def _why_not_started(code: int | None, printed: str) -> str:
    """Why a process did not start that ended with ``code``, or not in time if ``None``, and ``printed`` something."""
    lines = printed.strip().splitlines()[-_QUOTED:]
    if code is None:
        ended, advice = f"was not ready after {_START_LIMIT:g} s", "the machine may be overloaded"
    elif code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        ended = f"was ended by {name} (exit code {code})"
        advice = "the machine may lack memory" if -code == signal.SIGKILL else cure()
    else:
        ended = f"ended with exit code {code}"
        advice = "the lines above say why" if lines else "see whether `python -c 'import ocp_envs'` works"
    quoted = "\n".join(["it printed:", *lines]) if lines else "it printed nothing"
    return f"the solver process did not start: it {ended}; {quoted}\n{advice}"


def _start(errors: BinaryIO) -> subprocess.Popen[bytes]:
    """The process, which writes its standard error to the file ``errors``."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)  # the factory must be importable there too
    return subprocess.Popen(
        [sys.executable, "-P", "-c", "from ocp_envs.solvers.child import serve; serve()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        env={**os.environ, **threads, "PYTHONPATH": path},
    )


def _end(process: subprocess.Popen[bytes], errors: BinaryIO, parent: int) -> None:
    if parent == os.getpid():  # a forked process has copies of the pipes, but no right to the child
        process.kill()
        process.wait()
    for file in (process.stdin, process.stdout, errors):
        if file is not None:
            file.close()


def serve() -> None:
    """Solve what comes in, until the standard input ends; what the child runs."""
    channel = Channel(os.dup(0), os.dup(1))
    os.dup2(2, 1)  # what a solver prints must not get between the messages
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    factory, transcription, settings = channel.receive()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solver = factory(transcription, settings)
    tasks: queue.SimpleQueue[tuple[Task, bool, Limits]] = queue.SimpleQueue()

    def read() -> None:
        try:
            while True:
                tasks.put(channel.receive())
        except Gone:
            os._exit(0)  # the parent is gone; the main thread may be inside a solve that never ends

    channel.send([warning.message for warning in caught])
    threading.Thread(target=read, daemon=True).start()
    while True:
        task, skip_primary, limits = tasks.get()
        signal.alarm(_ALONE_LIMIT)
        cpu_limit.arm(limits)
        result = solver.solve(task, skip_primary)
        cpu_limit.disarm()
        signal.alarm(0)
        channel.send(result)
