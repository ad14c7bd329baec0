"""How a script runs: what it prints on any console, its errors in one line, and its end when it is interrupted.

An error of the user's input or of the machine is one line on standard error. A traceback is a fault of the program.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from pathlib import Path
from types import FrameType
from typing import NoReturn

from moe_policy.experiments import PACKAGES, install
from moe_policy.learning.checkpoint import CheckpointError
from moe_policy.model_files import ModelFileError
from moe_policy.reports.records import RecordError
from moe_policy.store import UnknownModelError
from ocp_envs.data.layout import DatabaseError
from ocp_envs.problems import UnknownProblemError
from ocp_envs.support import progress
from ocp_envs.support.pool import WorkerLostError
from ocp_envs.tables import TableError

#: Errors of the user's input or of the machine, whose messages say what to do.
EXPECTED = (
    BrokenExecutor,
    CheckpointError,
    DatabaseError,
    ModelFileError,
    RecordError,
    TableError,
    UnknownModelError,
    UnknownProblemError,
    WorkerLostError,
)
#: Seconds that an interrupted script has to end by itself. Whatever it writes is complete or absent at any moment.
GRACE = 1.0


class UsageError(SystemExit):
    """The command line asks for something that does not exist; its code is the message."""


@contextlib.contextmanager
def option(name: str) -> Iterator[None]:
    """A block that interprets the value of the option ``name``.

    Raises:
        UsageError: in place of an error about a value.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{name}: {error}") from error


def run(main: Callable[[], int | None], *, continues: bool = False) -> NoReturn:
    """Call ``main`` and exit with what it returns.

    An error of the user's input or of the machine is one line and ends in status 1, or 2 where it is of the command
    line. SIGINT (Ctrl-C) and SIGTERM end the script within two seconds, in status 130 and 143.

    Args:
        main: the script.
        continues: whether the same command continues after an interruption, which is then said.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a console without Greek letters shows question marks
    progress.show(True)
    interruption = _Interruption(continues)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interruption.handle)
    try:
        status = main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        interruption.tell()
        status = interruption.status
    except BrokenPipeError:  # such as after `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    except BaseException as error:
        if (message := message_of(error)) is None:
            raise
        _print(f"error: {message}")
        status = 2 if isinstance(error, UsageError) else 1
    sys.exit(status)


def message_of(error: BaseException) -> str | None:
    """What is wrong, in one line, where ``error`` is one of the user's input or of the machine; else ``None``."""
    match error:
        case SystemExit() if isinstance(error.code, str):
            message = error.code
        case ModuleNotFoundError() if (error.name or "").partition(".")[0] in PACKAGES:
            message = install((error.name or "").partition(".")[0])
        case OSError() if error.filename is not None:
            message = f"{os.fsdecode(error.filename)}: {error.strerror}"
        case OSError() if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EMFILE):
            message = str(error.strerror)
        case subprocess.CalledProcessError():
            message = f"{Path(error.cmd[1]).name} ended with status {error.returncode}"
        case MemoryError():
            message = f"not enough memory ({error})"
        case _ if isinstance(error, EXPECTED):
            message = str(error)
        case _:
            return None
    return "; ".join(line.strip() for line in message.splitlines() if line.strip())


class _Interruption:
    """Ends this process after a signal."""

    def __init__(self, continues: bool) -> None:
        self._words = "interrupted; the same command continues" if continues else "interrupted"
        self._told = threading.Lock()
        self.status = 128 + signal.SIGINT

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Interrupt the main thread, and end the process if that or other threads take too long."""
        self.status = 128 + number
        threading.Thread(target=self._end_soon, daemon=True).start()
        raise KeyboardInterrupt

    def tell(self) -> None:
        """Say once that the script was interrupted."""
        if self._told.acquire(blocking=False):
            _print(self._words)

    def _end_soon(self) -> None:
        threading.Event().wait(GRACE)
        self.tell()
        os._exit(self.status)


def _print(message: str) -> None:
    print(f"{Path(sys.argv[0]).name}: {message}", file=sys.stderr, flush=True)
