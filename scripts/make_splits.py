"""Make the hard sets of a problem with their reference costs.

``boundary``: instances near the discontinuity of the optimum; ``outside``: instances outside the parameter box;
``near``: instances near the goal. They are declared in ``ocp_envs/sets/splits.py``. Databases go to
``data/<env>/hard/``; an interrupted command continues when it is called again. Parameters and costs go to
``runs/tables/<env>/<set>.npz``, with ``--ship`` into the package; the record of their making is ``splits_<env>.json``.

    python scripts/make_splits.py --env GroundVehicle-v0
    python scripts/make_splits.py --splits boundary --cases 20
"""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from moe_policy.experiments import cli
from moe_policy.experiments.generation import HardSetReport, HardSets
from moe_policy.reports.records import read, write
from ocp_envs import tables
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.hard_sets import HardSet
from ocp_envs.sets.making import make, smaller
from ocp_envs.sets.reference import ReferenceSet
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.provenance import provenance


def made(
    problem: OptimalControlProblem, name: str, hard: HardSet, folder: Path, workers: int | None
) -> tuple[ReferenceSet, HardSetReport]:
    """The set ``hard`` called ``name``, solved in ``folder`` by ``workers`` processes, and how it was made."""
    resumed, began = (folder / f"{name}.zarr").exists(), time.perf_counter()
    found, told = make(problem, name, hard, folder, workers)
    run = {"seconds": time.perf_counter() - began, "resumed": resumed, "workers": workers}
    return found, HardSetReport.from_json({**told, **run, "provenance": provenance().to_json()})


def sets(problem: OptimalControlProblem, names: list[str] | None, cases: int | None) -> Mapping[str, HardSet]:
    """The declared sets called ``names``, or all, made smaller where ``cases`` are given."""
    declared = sets_of(problem)
    chosen = {name: declared.hard_set(name) for name in names or declared.hard}
    return chosen if cases is None else {name: smaller(hard, cases) for name, hard in chosen.items()}


def main() -> None:
    parser = cli.parser(
        __doc__,
        data=True,
        workers=True,
        cases="instances in each set, to try it out",
        ship="write the sets into the package and the record into results/, instead of runs/",
    )
    parser.add_argument("--splits", nargs="+", help="which sets; all by default")
    parser.add_argument("--tables", metavar="FOLDER", type=Path, help="where sets go; runs/tables by default")
    arguments = parser.parse()
    folder = arguments.tables or (tables.FOLDER if arguments.ship else cli.RUNS / "tables")
    if arguments.cases and folder == tables.FOLDER:
        parser.error("--cases makes smaller sets than those of the package; leave --ship out, or name another --tables")
    with cli.option("--splits"):
        wanted = sets(arguments.problem, arguments.splits, arguments.cases)
    problem, path = arguments.problem, arguments.results / f"splits_{arguments.problem.id}.json"
    databases = arguments.data / problem.id / "hard" / (str(arguments.cases) if arguments.cases else "")
    for name, hard in wanted.items():
        found, report = made(problem, name, hard, databases, arguments.workers)
        cli.say(f"wrote {reference.write(problem, name, found, folder)}")
        cli.say(f"{name}: {len(found)} of {report.candidates} candidates, {report.seconds:.0f} s")
        record = read(path, HardSets, HardSets(sets={}))
        write(path, replace(record, sets=record.sets | {name: report}))


if __name__ == "__main__":
    cli.run(main, continues=True)
