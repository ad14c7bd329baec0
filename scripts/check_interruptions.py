"""Does a generation whose processes are killed repeatedly end with the arrays of an undisturbed one?

The same instances are generated twice: without disturbance, and by processes that are killed (SIGKILL) at random
moments: the calling process, which is then started again with the same command, or one of its worker processes. The
record contains the kills with the number of chunks that were complete, the digests of both databases, and how many of
those chunks were written again (none should be). It is an error if a process outlives the one that started it. With
``--split`` the database under ``data/`` is the undisturbed one. Smaller chunks give more moments to kill at: the second
command kills a hundred processes in a few minutes.
Writes ``interruptions_<env>.json``.

    python scripts/check_interruptions.py --env PendulumSwingup-v0 --size 2000 --kills 10
    python scripts/check_interruptions.py --env PendulumSwingup-v0 --size 1500 --chunk 10 --kills 100 --delay 0.5
    python scripts/check_interruptions.py --env GroundVehicle-v0 --split validation
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.generation import Totals
from moe_policy.experiments.interruptions import Interruptions, generate_interrupted, plan_kills
from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.splits import InstanceSet, sets_of
from ocp_envs.support.provenance import provenance


def make(problem: OptimalControlProblem, split: InstanceSet, path: Path, workers: int | None) -> None:
    """Generate the database of ``split`` at ``path``."""
    p = split.parameters(problem)
    ocp_envs.generate(problem, path, p, workers=workers, seed=split.seed, settings=split.settings)


def complete(problem: OptimalControlProblem, split: InstanceSet, path: Path) -> Database:
    """The complete database at ``path``, made as ``split`` says."""
    database = Database.open(path, problem)
    record = {"seed": split.seed, **split.settings.record()}
    same = database.settings == record and np.array_equal(database.parameters, split.parameters(problem))
    if not (same and database.complete):
        raise DatabaseError(
            f"{path} is {'not complete' if same else 'made with other parameters, settings or seed'}; "
            "finish it, or omit --reference to make another"
        )
    return database


def parse() -> argparse.Namespace:
    parser = cli.parser(__doc__, data=True, workers=True, seed=0)
    parser.add_argument("--size", type=cli.positive, default=2000, help="number of random instances")
    parser.add_argument("--chunk", type=cli.positive, default=100, help="number of random instances solved in one task")
    parser.add_argument("--split", help="the instances of this split instead; its database is the reference")
    parser.add_argument(
        "--kills", type=cli.whole, default=6, help="number of processes that are killed; half are parents"
    )
    parser.add_argument("--delay", type=cli.amount, default=10.0, help="maximum time from a chunk to a kill, seconds")
    parser.add_argument("--reference", type=Path, help="complete database of the same instances; made by default")
    parser.add_argument("--folder", type=Path, help="where the databases are made; a temporary folder by default")
    parser.add_argument("--generate-into", type=Path, help=argparse.SUPPRESS)  # what the killed process does
    return parser.parse()


def check(arguments: argparse.Namespace, split: InstanceSet, folder: Path) -> Interruptions:
    """Generate twice in ``folder``, once with kills, and compare."""
    problem, reference, seconds = arguments.problem, arguments.reference, None
    path = folder / "interrupted.zarr"
    if path.exists():
        raise SystemExit(f"{path} exists; remove it or choose another --folder")
    if reference is None and arguments.split:
        reference = arguments.data / problem.id / f"{arguments.split}.zarr"
    if reference is None:
        reference, began = folder / "whole.zarr", time.perf_counter()
        make(problem, split, reference, arguments.workers)
        seconds = time.perf_counter() - began
    whole = complete(problem, split, reference)
    kinds = ["parent"] * -(-arguments.kills // 2) + ["worker"] * (arguments.kills // 2)
    command = [sys.executable, __file__, *sys.argv[1:], "--generate-into", str(path)]
    kills = plan_kills(kinds, whole.chunks, arguments.delay, arguments.seed)
    interrupted = generate_interrupted(command, path, kills, cli.say)
    database = complete(problem, split, path)
    digests = {"reference": whole.digest(), "interrupted": database.digest()}
    return Interruptions(
        interrupted=interrupted,
        digests=digests,
        equal=digests["reference"] == digests["interrupted"],
        reference_seconds=seconds,
        env_id=problem.id,
        split=arguments.split,
        seed=arguments.seed,
        totals=Totals.of(database),
        settings=database.settings,
        provenance=provenance(),
    )


def main() -> None:
    arguments = parse()
    problem = arguments.problem
    with cli.option("--split"):
        named = sets_of(problem).split(arguments.split) if arguments.split else None
    settings = GenerationSettings(chunk=arguments.chunk)
    split = named or InstanceSet(arguments.size, arguments.seed, settings=settings)
    if arguments.generate_into:
        make(problem, split, arguments.generate_into, arguments.workers)
        return
    with tempfile.TemporaryDirectory() as temporary:
        record = check(arguments, split, arguments.folder or Path(temporary))
    again = record.interrupted.chunks_written_again
    cli.publish(arguments, f"interruptions_{problem.id}", record)
    cli.say(f"{len(record.interrupted.kills)} kills, {again} chunks written again; equal arrays: {record.equal}")
    if not record.equal or again:
        raise SystemExit("the interrupted database differs from the undisturbed one")


if __name__ == "__main__":
    cli.run(main)
