"""A limit on the processor time of this process, which ends it also inside a C call.

Processor time, unlike wall-clock time, hardly depends on what else the machine does. The process ends by the signal
:data:`SIGNAL`, which is left to its default action because Python would handle it only after the call.
"""

from __future__ import annotations

import signal
from typing import NamedTuple

#: Ends a process whose limit is used up.
SIGNAL = signal.SIGPROF


class Limits(NamedTuple):
    """Seconds of processor time that the ``primary`` and the ``fallback`` solver may each take for one solve."""

    primary: float
    fallback: float


_armed: Limits | None = None


def arm(limits: Limits) -> None:
    """Limit this process from now on, to ``limits`` of the primary solver."""
    global _armed
    _armed = limits
    signal.signal(SIGNAL, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, limits.primary)


def begin_fallback() -> None:
    """The fallback solver begins, with a limit of its own; nothing where no limit is armed."""
    if _armed is not None:
        signal.setitimer(signal.ITIMER_PROF, _armed.fallback)


def disarm() -> None:
    """End the limit."""
    global _armed
    _armed = None
    signal.setitimer(signal.ITIMER_PROF, 0.0)
