"""Progress of long work: a bar on a terminal, elsewhere a line a minute, and nothing for work of less than a minute.

A library is silent where nobody watches: without a terminal, lines are written only where a caller or its program asks
for them (:func:`show`).
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self, TypeVar

from tqdm import tqdm

T = TypeVar("T")

#: Seconds between two lines, and before the first one.
INTERVAL = 60.0
#: A bar whose time left is told among the facts, since the pieces differ.
_WITHOUT_RATE = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}{postfix}]"
#: What ``shown=None`` means in this process.
_shown: bool | None = None


def show(shown: bool | None) -> None:
    """Decide how this process shows progress where a caller of :class:`Progress` does not.

    Args:
        shown: ``True`` for a bar on a terminal and lines elsewhere, ``None`` for the bar alone, ``False`` for nothing.
    """
    global _shown
    _shown = shown


@dataclass(frozen=True)
class Expectation:
    """How long pieces are expected to take that do not all take equally long.

    Args:
        work: the time that the first n pieces take together, on one of the workers, in seconds.
        workers: number of workers.
    """

    work: Callable[[int], float]
    workers: int = 1

    def left(self, done: int, total: int, initial: int, elapsed: float) -> float:
        """Seconds left for ``total`` pieces, of which ``initial`` were ``done`` before and took no ``elapsed`` time.

        The times are corrected by what the pieces took that are done.
        """
        new = self.work(done) - self.work(initial)
        return (self.work(total) - self.work(done)) * (elapsed / new if new > 0 else 1 / self.workers)


class Progress:
    """How many of ``total`` pieces of work are done; a context.

    Args:
        total: number of pieces.
        unit: what one of them is, such as ``"instance"``.
        label: what is being done.
        initial: number of pieces that were done before.
        shown: as for :func:`show`; ``None`` for what that decided.
        leave: keep the bar on the terminal after the end.
    """

    def __init__(
        self, total: int, *, unit: str, label: str, initial: int = 0, shown: bool | None = None, leave: bool = True
    ) -> None:
        shown, terminal = _shown if shown is None else shown, sys.stderr is not None and sys.stderr.isatty()
        hidden = not terminal or shown is False
        self.shown = bool(not hidden or shown)
        self._total, self._done, self._initial = total, initial, initial
        self._expectation: Expectation | None = None
        self._bar = tqdm(total=total, unit=unit, desc=label, initial=initial, leave=leave, disable=hidden)
        self._lines = _Lines(total, unit, label, initial) if shown and not terminal else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def say(self, text: str) -> None:
        """Write ``text`` on standard error, above the bar, where progress is shown."""
        if self.shown:
            tqdm.write(text, file=sys.stderr)

    def expect(self, expectation: Expectation) -> None:
        """Tell the time left by an ``expectation``, from now on."""
        self._expectation, self._began = expectation, time.monotonic()
        self._bar.bar_format = _WITHOUT_RATE
        if self._lines is not None:
            self._lines.expect(expectation)

    def update(self, count: int = 1, **facts: object) -> None:
        """Count ``count`` pieces as done; ``facts`` are shown with them, such as ``failed=3``."""
        self._bar.update(count)
        self._done += count
        shown = dict(facts)
        if self._expectation is not None and self._done < self._total:
            elapsed = time.monotonic() - self._began
            shown["left"] = duration(self._expectation.left(self._done, self._total, self._initial, elapsed))
        if shown:
            self._bar.set_postfix(shown)
        if self._lines is not None:
            self._lines.update(count, facts)

    def close(self) -> None:
        """End the bar, or write a last line if there was one."""
        self._bar.close()
        if self._lines is not None:
            self._lines.close()


def track(
    items: Iterable[T], total: int, *, unit: str, label: str, shown: bool | None = None, leave: bool = True
) -> Iterator[T]:
    """The ``items``, each of which counts as done when the next one is asked for.

    Args:
        items: any number of them.
        total: how many there are.
        unit: as for :class:`Progress`, and so are ``label``, ``shown`` and ``leave``.
    """
    with Progress(total, unit=unit, label=label, shown=shown, leave=leave) as progress:
        for item in items:
            yield item
            progress.update()


class _Lines:
    """Progress as lines on standard error, which a thread writes: a piece of work may take more than a minute."""

    def __init__(self, total: int, unit: str, label: str, initial: int) -> None:
        self._total, self._unit, self._label, self._initial = total, unit, label, initial
        self._done, self._facts, self._told = initial, dict[str, object](), -1
        self._expectation: Expectation | None = None
        self._began, self._ended = time.monotonic(), threading.Event()
        threading.Thread(target=self._tell, name="progress", daemon=True).start()

    def expect(self, expectation: Expectation) -> None:
        self._expectation, self._began = expectation, time.monotonic()

    def update(self, count: int, facts: dict[str, object]) -> None:
        self._facts = self._facts | facts
        self._done += count

    def close(self) -> None:
        self._ended.set()
        if 0 <= self._told < self._done:
            self._write()

    def _tell(self) -> None:
        while not self._ended.wait(INTERVAL):
            self._write()

    def _write(self) -> None:
        self._told, elapsed = self._done, time.monotonic() - self._began
        words = describe(self._told, self._total, self._unit, elapsed, self._initial, self._expectation)
        told = ", ".join([words, *(f"{name} {value}" for name, value in self._facts.items())])
        sys.stderr.write(f"{self._label}: {told}\n")
        sys.stderr.flush()


def describe(
    done: int, total: int, unit: str, elapsed: float, initial: int = 0, expectation: Expectation | None = None
) -> str:
    """Progress in words: how much is done, since when, how fast, and how much time is left.

    Args:
        done: number of pieces that are done.
        total: number of all pieces.
        unit: what one of them is.
        elapsed: time since this run began, in seconds.
        initial: number of pieces that were done before it.
        expectation: how long pieces take; by default all of them equally long.
    """
    told, new = [f"{done:,} of {total:,} {unit}s", f"{duration(elapsed)} so far"], done - initial
    if new:
        told.append(rate(new / elapsed, unit))
    if new or expectation is not None:
        expected = expectation or Expectation(float)
        told.append(f"{duration(expected.left(done, total, initial, elapsed))} left")
    return ", ".join(told)


def rate(per_second: float, unit: str) -> str:
    """``per_second`` pieces, each a ``unit``, in words such as ``"20 instances/s"`` or ``"40 s per instance"``."""
    if per_second < 1:
        return f"{1 / per_second:.3g} s per {unit}"
    return f"{per_second:,.0f} {unit}s/s" if per_second >= 100 else f"{per_second:.3g} {unit}s/s"


def duration(seconds: float) -> str:
    """``seconds`` in words, such as ``"40 s"``, ``"5 min"`` or ``"2 h 05 min"``."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
