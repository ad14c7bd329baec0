"""Does a generation that is killed again and again end with the arrays of one that is left alone?

The same problems are generated twice: at one go, and by processes that are killed (SIGKILL) at random moments: the
calling process, which is then started again with the same command, or one of its worker processes. Recorded are the
kills with the number of chunks that were there, the digests of both databases, and how many chunks that were there at
a kill were written again (none should be). With ``--split`` the database under ``data/`` is the one left alone.

    python scripts/check_interruptions.py --env PendulumSwingup-v0 --size 2000 --kills 10
    python scripts/check_interruptions.py --env GroundVehicle-v0 --split validation
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import ocp_envs
from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.splits import Split, split_of
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
#: Seconds after which a generation without a new chunk counts as stuck.
STUCK = 1800.0
#: How a process that must die is found: words of its command line.
WORKER, SOLVER = b"spawn_main", b"serve()"


@dataclasses.dataclass(frozen=True)
class Kill:
    """A process is killed some time after a number of chunks is there.

    Args:
        kind: "parent", "worker" or "solver" (the child in which a worker solves).
        chunks: number of chunks to wait for.
        delay: seconds from then on.
    """

    kind: str
    chunks: int
    delay: float


def plan_kills(kinds: Sequence[str], chunks: int, delay: float, seed: int) -> list[Kill]:
    """A kill for each of ``kinds``, at random moments of a generation of ``chunks`` chunks."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.integers(0, max(1, int(0.8 * chunks)), len(kinds)))
    return [Kill(str(kind), int(n), float(rng.uniform(0, delay))) for kind, n in zip(rng.permutation(list(kinds)), at)]


def stored_chunks(path: Path) -> dict[int, int]:
    """When each chunk that is there was written, in ns."""
    return {int(file.name): file.stat().st_mtime_ns for file in (path / "status").glob("c/*") if file.name.isdigit()}


def descendants(process: int) -> list[int]:
    """Processes that ``process`` started, and those that they started."""
    found = []
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        for child in children.read_text().split():
            found += [int(child), *descendants(int(child))]
    return found


def victim(process: int, kind: str) -> int | None:
    """The process that a kill of ``kind`` hits; ``None`` while there is none."""
    if kind == "parent":
        return process
    words = {"worker": WORKER, "solver": SOLVER}[kind]
    for child in descendants(process):
        command = Path(f"/proc/{child}/cmdline").read_bytes()
        # The parent's own solver child only compiles.
        parent = int(Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[1])
        if words in command and (kind == "worker" or parent != process):
            return child
    return None


def strike(process: subprocess.Popen[bytes], kind: str) -> bool:
    """Kill what ``kind`` names as soon as it is there; whether it still was."""
    deadline = time.monotonic() + STUCK
    while process.poll() is None:
        try:
            found = victim(process.pid, kind)
            if found is not None:
                os.kill(found, signal.SIGKILL)
                return True
        except (FileNotFoundError, ProcessLookupError):
            pass  # it ended just now
        if time.monotonic() > deadline:
            raise SystemExit(f"no {kind} process to kill in {STUCK:.0f} s")
        time.sleep(0.01)
    return False


def wait_for_chunks(process: subprocess.Popen[bytes], path: Path, count: int) -> None:
    """Wait until ``count`` chunks are there, or the process has ended."""
    last, since = -1, time.monotonic()
    while process.poll() is None and (there := len(stored_chunks(path))) < count:
        if there != last:
            last, since = there, time.monotonic()
        if time.monotonic() - since > STUCK:
            raise SystemExit(f"no chunk came in {STUCK:.0f} s; {there} of {count} are there")
        time.sleep(0.02)


def generate_interrupted(command: Sequence[str], path: Path, kills: Sequence[Kill]) -> dict[str, Any]:
    """Run ``command``, which generates into ``path``, with ``kills``; what happened.

    Raises:
        RuntimeError: the command failed by itself.
    """
    began, done, starts, rewritten = time.perf_counter(), [], 1, 0
    before: dict[int, int] = {}
    process = subprocess.Popen(command)
    try:
        for kill in kills:
            wait_for_chunks(process, path, kill.chunks)
            time.sleep(kill.delay)
            if not strike(process, kill.kind):
                break  # it came to its end first
            there = stored_chunks(path)
            rewritten += sum(there.get(chunk) != written for chunk, written in before.items())
            before = there
            done.append({"kind": kill.kind, "chunks": len(there), "seconds": time.perf_counter() - began})
            print(f"killed: {kill.kind} after {len(there)} chunks", flush=True)
            if kill.kind == "parent":
                process.wait()
                process = subprocess.Popen(command)
                starts += 1
        if process.wait() != 0:
            raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    finally:
        process.kill()
        process.wait()
    there = stored_chunks(path)
    rewritten += sum(there.get(chunk) != written for chunk, written in before.items())
    kinds = Counter(str(kill["kind"]) for kill in done)
    return {
        "kills": done,
        "kills_by_kind": dict(kinds),
        "starts": starts,
        "chunks": len(there),
        "chunks_written_again": rewritten,
        "seconds": time.perf_counter() - began,
    }


def make(problem: OptimalControlProblem, split: Split, path: Path, workers: int | None) -> None:
    p = split.parameters(problem)
    ocp_envs.generate(problem, path, p, workers=workers, seed=split.seed, settings=split.settings)


def check_reference(problem: OptimalControlProblem, split: Split, path: Path) -> Database:
    """The complete database at ``path``, made as ``split`` says."""
    database = Database.open(path, problem)
    record = {"seed": split.seed, **split.settings.record()}
    same = database.settings == record and np.array_equal(database.parameters, split.parameters(problem))
    if not (same and database.complete):
        raise DatabaseError(
            f"{path} is {'not complete' if same else 'made with other parameters, settings or seed'}; "
            "finish it, or leave --reference out to make another"
        )
    return database


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--size", type=int, default=2000, help="number of random problems")
    parser.add_argument("--split", help="the problems of this split instead; its database is the reference")
    parser.add_argument("--kills", type=int, default=6, help="how many processes are killed; half of them parents")
    parser.add_argument("--delay", type=float, default=10.0, help="a kill comes up to so many s after a chunk")
    parser.add_argument("--seed", type=int, default=0, help="of the problems (without --split) and of the moments")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--reference", type=Path, help="complete database of the same problems; made where not given")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the splits' databases")
    parser.add_argument("--folder", type=Path, help="where the databases are made; a temporary folder by default")
    parser.add_argument("--output", type=Path, help="results/interruptions_<env>.json by default")
    parser.add_argument("--generate-into", type=Path, help=argparse.SUPPRESS)  # what the killed process does
    return parser.parse_args()


def main() -> None:
    arguments = parse()
    problem = ocp_envs.load(arguments.env)
    split = split_of(problem, arguments.split) if arguments.split else Split(arguments.size, arguments.seed)
    if arguments.generate_into:
        make(problem, split, arguments.generate_into, arguments.workers)
        return
    reference = arguments.reference
    if reference is None and arguments.split:
        reference = arguments.data / problem.id / f"{arguments.split}.zarr"
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        path, seconds = folder / "interrupted.zarr", None
        if path.exists():
            raise SystemExit(f"{path} exists; remove it or choose another --folder")
        if reference is None:
            reference, began = folder / "whole.zarr", time.perf_counter()
            make(problem, split, reference, arguments.workers)
            seconds = time.perf_counter() - began
        whole = check_reference(problem, split, reference)
        kinds = ["parent"] * -(-arguments.kills // 2) + ["worker"] * (arguments.kills // 2)
        command = [sys.executable, __file__, *sys.argv[1:], "--generate-into", str(path)]
        record = generate_interrupted(command, path, plan_kills(kinds, whole.chunks, arguments.delay, arguments.seed))
        database = check_reference(problem, split, path)
        digests = {"reference": whole.digest(), "interrupted": database.digest()}
        totals, settings = database.totals(), database.settings
    equal = digests["reference"] == digests["interrupted"]
    record |= {"digests": digests, "equal": equal, "reference_seconds": seconds}
    record |= {"problem": problem.id, "split": arguments.split, "seed": arguments.seed, "totals": totals}
    output = arguments.output or ROOT / "results" / f"interruptions_{problem.id}.json"
    write_json(output, record | {"settings": settings, "provenance": provenance()})
    print(f"{len(record['kills'])} kills, {record['chunks_written_again']} chunks written again; equal arrays: {equal}")
    if not equal or record["chunks_written_again"]:
        raise SystemExit("the interrupted database is another one")


if __name__ == "__main__":
    main()
