"""What threads need to share objects: a lock that belongs to one process, and a few objects for many threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

T = TypeVar("T")


class ProcessLock:
    """A lock that one thread may take again. In a forked process, in copies and after unpickling it is free.

    A thread that holds a lock while another one forks does not exist in the new process, where an ordinary lock would
    therefore be held for ever.
    """

    def __init__(self) -> None:
        self._lock, self._process = threading.RLock(), os.getpid()

    def acquire(self, blocking: bool = True) -> bool:
        """Take the lock; where another thread has it, wait, or return ``False`` at once if not ``blocking``."""
        if self._process != os.getpid():
            self._lock, self._process = threading.RLock(), os.getpid()
        return self._lock.acquire(blocking)

    def release(self) -> None:
        """Give the lock back."""
        self._lock.release()

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *exception: object) -> None:
        self.release()

    def __reduce__(self) -> tuple[object, ...]:
        return ProcessLock, ()


class Loans(Generic[T]):
    """Objects that threads borrow, each for one thread at a time.

    An object given back is lent next. Where none is, ``make`` makes one, and where ``limit`` of them are lent, the
    thread waits.
    """

    def __init__(self, make: Callable[[], T], limit: int) -> None:
        self._make, self._places = make, threading.BoundedSemaphore(limit)
        self._idle: list[T] = []

    @contextmanager
    def one(self) -> Iterator[T]:
        """The context that has an object to itself."""
        with self._places:
            try:
                lent = self._idle.pop()
            except IndexError:
                lent = self._make()
            try:
                yield lent
            finally:
                self._idle.append(lent)
