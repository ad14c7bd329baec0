"""Make the tables from which parameters are drawn where drawing takes an optimiser, and write them into the package.

``reference/<id of the free problem>/paths.npz``: optimal paths of the problem without its path constraint, between
which others are interpolated, with the maximum error on fresh ones. ``reference/<env>/starts.npz``: parameters among
which ``env.reset()`` draws, with a seed of their own. A valid table is kept, so the same command resumes after an
interruption; ``--again --ship`` replaces it. Writes ``starts_<env>.json``.

    python scripts/make_starts.py --env QuadcopterObstacle-v0
"""

from dataclasses import replace

from moe_policy.experiments import cli
from moe_policy.experiments.generation import STARTS, StartTables
from moe_policy.reports.records import read, write
from ocp_envs import tables
from ocp_envs.distribution import Blocked
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.sets import free_paths
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.provenance import provenance


def main() -> None:
    parser = cli.parser(__doc__, env=QUADCOPTER_OBSTACLE.id, workers=True)
    parser.add_argument("--starts", type=cli.positive, default=10_000, help="parameters in the table of starts")
    parser.add_argument("--paths", type=cli.positive, default=5_000, help="paths in the table of paths")
    parser.add_argument("--fresh", type=cli.positive, default=1_000, help="paths on which the error is measured")
    parser.add_argument("--again", action="store_true", help="replace existing tables; needs --ship")
    arguments = parser.parse()
    if arguments.again and not arguments.ship:
        parser.error("--again replaces tables of the package; add --ship if that is meant")

    problem = arguments.problem
    if not isinstance(problem.distribution, Blocked):
        raise SystemExit(f"{problem.id} draws its parameters uniformly and needs no tables")
    if STARTS in {split.seed for split in sets_of(problem).splits.values()}:
        raise SystemExit(f"seed {STARTS} of the table is that of a split")
    path = arguments.results / f"starts_{problem.id}.json"
    earlier = read(path, StartTables) if path.exists() else StartTables(provenance=provenance())
    record = earlier
    if arguments.again or free_paths.shipped(problem) is None:
        record = record.with_paths(problem, arguments.paths, arguments.fresh, cli.say)
        free_paths.shipped.cache_clear()
    try:
        if arguments.again:
            raise tables.TableError
        tables.starts(problem)
    except tables.TableError:
        record = record.with_starts(problem, arguments.starts, arguments.workers or 1, cli.say)
    if record is not earlier:
        write(path, replace(record, provenance=provenance()))
        cli.say(f"wrote {path}")


if __name__ == "__main__":
    cli.run(main, continues=True)
