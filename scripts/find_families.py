"""Find solution families by continuation between neighbouring instances, and compare them with the declared ones.

Each family is continued beyond its border, to see how much more it costs there. Needs the database ``training`` of
``scripts/generate_data.py``, which need not be complete. Solves between neighbours are kept under
``data/<env>/training.continuation``: an interrupted command continues where it stopped, and
``scripts/train_planners.py --names moe-auto`` has them. Writes ``families_<env>.json`` and
``families_<env>.png``, and all problems' records as ``table_families.json``.

    python scripts/find_families.py
    python scripts/find_families.py --env GroundVehicle-v0 --cases 6000 --over theta v
"""

import os
import time

from moe_policy.experiments import cli
from moe_policy.experiments.families import FAMILY_COLUMNS, FamiliesTable, Gaps, families
from moe_policy.experiments.figures.families import families_figure
from moe_policy.learning.families import NEIGHBOURS, families_of
from moe_policy.learning.graph_cuts import Parts
from moe_policy.reports.records import ABSENT, Absent
from moe_policy.reports.tables import text_table
from ocp_envs.data.beyond import beyond
from ocp_envs.data.continuation import Continuation, continued
from ocp_envs.data.samples import Samples
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import provenance

#: Largest excess of the cost with which a family is continued beyond its border.
MARGIN = 0.3


def gaps_of(samples: Samples, continuation: Continuation, parts: Parts) -> tuple[Gaps | Absent, Array | None]:
    """How far the families ``parts`` of ``samples`` are known beyond their borders, and their costs (M, k)."""
    if not parts.values.any():
        return ABSENT, None
    began = time.perf_counter()
    found = beyond(samples, parts.values, MARGIN, pairs=continuation.pairs)
    return Gaps.of(samples, found, MARGIN, time.perf_counter() - began), found.cost


def main() -> None:
    parser = cli.parser(__doc__, data=True, workers=True, cases="instances, of those that are solved first")
    parser.add_argument("--over", nargs=2, metavar="NAME", help="two parameters over which families are drawn")
    arguments = parser.parse()
    problem, over = arguments.problem, arguments.over
    if unknown := sorted(set(over or ()) - set(problem.parameters.names)):
        parser.error(f"--over: {problem.id} has no parameters {unknown}; there are {list(problem.parameters.names)}")
    database = cli.database(arguments, "training")
    samples = database.samples(None if arguments.cases is None else database.first(arguments.cases))
    kept = arguments.data / problem.id / "training.continuation"
    began, before = time.perf_counter(), set(kept.glob("*.zarr"))
    found = continued(samples, kept, neighbours=NEIGHBOURS, workers=arguments.workers)
    seconds = time.perf_counter() - began if set(kept.glob("*.zarr")) > before else None
    parts = families_of(samples, found)
    gaps, costs = gaps_of(samples, found, parts)
    record = families(
        samples,
        found,
        parts,
        training_key=database.key,
        seconds=seconds,
        workers=arguments.workers or os.cpu_count() or 1,
        provenance=provenance(),
        gaps=gaps,
    )
    path = cli.publish(arguments, f"families_{problem.id}", record)
    cli.say(f"wrote {families_figure(path.with_suffix('.png'), samples, parts, costs, over)}")
    cli.publish(arguments, "table_families", FamiliesTable.of(arguments.results, provenance()))
    print(text_table((record,), FAMILY_COLUMNS))


if __name__ == "__main__":
    cli.run(main, continues=True)
