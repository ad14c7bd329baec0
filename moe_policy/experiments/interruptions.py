"""A generation whose processes are killed (SIGKILL) at random moments."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.experiments.generation import Totals
from moe_policy.reports.records import Record, inline
from ocp_envs.support.provenance import Provenance

#: Seconds without a new chunk after which a generation counts as stuck.
STUCK = 1800.0
#: Words in the command line of a worker, and of a solver.
WORKER, SOLVER = b"spawn_main", b"serve()"


@dataclass(frozen=True)
class Kill:
    """A process to be killed."""

    kind: str  # "parent", "worker" or "solver" (the child in which a worker solves)
    chunks: int  # number of complete chunks to wait for
    delay: float  # seconds to wait after that


@dataclass(frozen=True, kw_only=True)
class Killed(Record):
    """A process that was killed, the number of chunks that were complete, and the seconds since the beginning."""

    kind: str
    chunks: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Interrupted(Record):
    """A generation whose processes were killed.

    ``starts``: how often it was started; ``chunks_written_again``: complete chunks that were written after a kill.
    """

    kills: tuple[Killed, ...]
    kills_by_kind: dict[str, int]
    starts: int
    chunks: int
    chunks_written_again: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Interruptions(Record):
    """An interrupted generation and an undisturbed one, which took ``reference_seconds`` unless it existed before."""

    interrupted: Interrupted = inline()
    digests: dict[str, str]
    equal: bool
    reference_seconds: float | None
    env_id: str
    split: str | None
    seed: int
    totals: Totals
    settings: object
    provenance: Provenance


def plan_kills(kinds: Sequence[str], chunks: int, delay: float, seed: int) -> list[Kill]:
    """A kill of each kind, at random moments of a generation of ``chunks``; delays are up to ``delay`` seconds."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.integers(0, max(1, int(0.8 * chunks)), len(kinds)))
    return [Kill(str(kind), int(n), float(rng.uniform(0, delay))) for kind, n in zip(rng.permutation(list(kinds)), at)]


def stored_chunks(path: Path) -> dict[int, int]:
    """When each complete chunk of the database at ``path`` was written, nanoseconds."""
    return {int(file.name): file.stat().st_mtime_ns for file in (path / "status").glob("c/*") if file.name.isdigit()}


def descendants(process: int) -> list[int]:
    """Ids of the processes that ``process`` started, and of those that they started."""
    found = []
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        for child in children.read_text().split():
            found += [int(child), *descendants(int(child))]
    return found


def _victim(process: int, kind: str) -> int | None:
    """The process that a kill of ``kind`` ends; ``None`` while none exists."""
    if kind == "parent":
        return process
    words = {"worker": WORKER, "solver": SOLVER}[kind]
    for child in descendants(process):
        command = Path(f"/proc/{child}/cmdline").read_bytes()
        # The parent's own solver only compiles.
        parent = int(Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[1])
        if words in command and (kind == "worker" or parent != process):
            return child
    return None


def _strike(process: subprocess.Popen[bytes], kind: str) -> bool:
    """Kill the process that ``kind`` names as soon as it exists; ``False`` if the generation ended before."""
    deadline = time.monotonic() + STUCK
    while process.poll() is None:
        try:
            found = _victim(process.pid, kind)
            if found is not None:
                os.kill(found, signal.SIGKILL)
                return True
        except (FileNotFoundError, ProcessLookupError):
            pass  # it has just ended
        if time.monotonic() > deadline:
            raise TimeoutError(f"found no {kind} process to kill in {STUCK:.0f} s")
        time.sleep(0.01)
    return False


def wait_for_chunks(process: subprocess.Popen[bytes], path: Path, count: int) -> None:
    """Wait until ``count`` chunks of the database at ``path`` are complete, or ``process`` has ended.

    Raises:
        TimeoutError: no new chunk for :data:`STUCK` seconds.
    """
    last, since = -1, time.monotonic()
    while process.poll() is None and (there := len(stored_chunks(path))) < count:
        if there != last:
            last, since = there, time.monotonic()
        if time.monotonic() - since > STUCK:
            raise TimeoutError(f"no new chunk in {STUCK:.0f} s; {there} of {count} are complete")
        time.sleep(0.02)


def generate_interrupted(
    command: Sequence[str], path: Path, kills: Sequence[Kill], say: Callable[[str], None] = print
) -> Interrupted:
    """Run ``command``, which generates into ``path``, and kill its processes; a killed parent is started again.

    Kills after the end of the generation are left out; ``say`` is told of every one.

    Raises:
        RuntimeError: the command failed by itself, or processes that it started are still there in the end.
        TimeoutError: the generation is stuck.
    """
    began, done, starts, rewritten, started = time.perf_counter(), [], 1, _Rewritten(path), _Started()
    process = subprocess.Popen(command)
    try:
        for kill in kills:
            wait_for_chunks(process, path, kill.chunks)
            time.sleep(kill.delay)
            started.look(process.pid)
            if not _strike(process, kill.kind):
                break
            done.append(Killed(kind=kill.kind, chunks=rewritten.look(), seconds=time.perf_counter() - began))
            say(f"killed: {kill.kind} after {done[-1].chunks} chunks")
            if kill.kind == "parent":
                process.wait()
                process = subprocess.Popen(command)
                starts += 1
        if process.wait() != 0:
            raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
        if left := started.left():
            raise RuntimeError(f"{len(left)} processes outlived the one that started them: {left}")
    finally:
        process.kill()
        process.wait()
    return Interrupted(
        kills=tuple(done),
        kills_by_kind=dict(Counter(kill.kind for kill in done)),
        starts=starts,
        chunks=rewritten.look(),
        chunks_written_again=rewritten.count,
        seconds=time.perf_counter() - began,
    )


class _Started:
    """Notes the processes that others started, and tells which of them are left."""

    def __init__(self) -> None:
        self._seen: set[tuple[int, str]] = set()

    def look(self, process: int) -> None:
        """Note what ``process`` has started until now."""
        self._seen |= {(child, since) for child in descendants(process) if (since := _running_since(child))}

    def left(self, patience: float = 30.0) -> list[int]:
        """Those that are still there after at most ``patience`` seconds."""
        deadline = time.monotonic() + patience
        while left := [child for child, since in self._seen if _running_since(child) == since]:
            if time.monotonic() > deadline:
                break
            time.sleep(0.05)
        return left


def _running_since(process: int) -> str | None:
    """When ``process`` began, which tells it from a later one of the same number; ``None`` where it has ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] == "Z" else fields[19]


class _Rewritten:
    """Counts the chunks of the database at ``path`` that were written again since the last look."""

    def __init__(self, path: Path) -> None:
        self.path, self.count = path, 0
        self._before: dict[int, int] = {}

    def look(self) -> int:
        """Count; the number of complete chunks."""
        now = stored_chunks(self.path)
        self.count += sum(now.get(chunk) != written for chunk, written in self._before.items())
        self._before = now
        return len(now)
