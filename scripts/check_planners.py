"""Measure planners as they are, repaired by a few iterations of the solver, and checked, on the splits of a problem.

Each planner is also repaired with 3, 5 and 10 iterations of the solver from its plan, and until the solver converges;
the checked planner is the shipped one, whose verdicts are compared with what happens. The instances are those of
``scripts/compare_splits.py``, or with ``--development`` those on which settings are chosen. Repaired planners are
measured on the first 2,000 instances of a split. What is promised of fresh instances is calibrated on the development
set and compared with the validation set. Writes ``planners_checked_<env>.json``. Finished rows are kept in
``data/checked/``; the same command continues after an interruption, and the pendulum takes about three minutes.

    python scripts/check_planners.py --env GroundVehicle-v0
    python scripts/check_planners.py --development --cases 100
"""

import time
from collections.abc import Sequence
from pathlib import Path

from moe_policy.experiments import cli
from moe_policy.experiments.checking import (
    BoundRow,
    CheckRow,
    Measured,
    PlannerChecks,
    PlanTime,
    kept,
    planners,
)
from moe_policy.experiments.checking_tables import BOUND_COLUMNS, CHECK_COLUMNS, TIME_COLUMNS, lines
from moe_policy.experiments.comparison import Optimum, track_optimum
from moe_policy.experiments.methods import shipped
from moe_policy.reports.tables import text_table
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.reference import SPLITS, ReferenceSet
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance

#: Number of instances of a split, the first ones, on which repaired planners are measured, and that are timed.
FEWER, TIMED = 2_000, 300
#: Probability of what is promised of fresh instances.
LEVEL = 0.95


def rows_on(
    problem: OptimalControlProblem, methods: Sequence[Method], split: str, cases: ReferenceSet, data: Path
) -> tuple[Optimum, dict[str, Measured]]:
    """The optimum and what is measured of all ``methods`` on the ``cases`` of one ``split``, kept in ``data``."""
    p = cases.parameters
    optimum = track_optimum(problem, p, cases.cost, shipped(problem), data / "optimal" / problem.id)
    found = {}
    for method in track(methods, len(methods), unit="planner", label=split, leave=False):
        few = p[:FEWER] if "repaired" in method.name else p
        found[method.name] = kept(problem, method, few, optimum, data / "checked" / problem.id)
        cli.say(f"{split}, {method.name}: {found[method.name].row.row.metrics.success.count} of {len(few)}")
    return optimum, found


def main() -> None:
    parser = cli.parser(__doc__, data=True, cases="instances of every split, at most")
    parser.add_argument("--development", action="store_true", help="use the development set alone")
    arguments = parser.parse()
    cli.threads()
    problem, began = arguments.problem, time.perf_counter()
    there = {split: name for split, name in SPLITS.items() if name == "validation" or name in sets_of(problem).hard}
    chosen = {"development": "development"} if arguments.development else there
    sets = {split: reference.load(problem, name)[: arguments.cases] for split, name in chosen.items()}
    methods = planners(problem, shipped(problem))
    splits, measured = {}, {}
    for split, cases in sets.items():
        optimum, measured[split] = rows_on(problem, methods, split, cases, arguments.data)
        splits[split] = (CheckRow(row=optimum.row), *(found.row for found in measured[split].values()))
    first = next(iter(sets.values())).parameters[:TIMED]
    times = tuple(
        PlanTime.of(method.name, method.planner, first)
        for method in track(methods, len(methods), unit="planner", label="times", leave=False)
        if method.planner is not None
    )
    bounds: tuple[BoundRow, ...] = ()
    if "uniform" in measured:
        promised = [method for method in methods if "repaired" not in method.name]
        known = reference.load(problem, "development")[: arguments.cases]
        _, calibration = rows_on(problem, promised, "development", known, arguments.data)
        bounds = tuple(
            BoundRow.of(name, found.scores, measured["uniform"][name].scores, LEVEL)
            for name, found in calibration.items()
        )
    record = PlannerChecks(
        env_id=problem.id,
        splits=splits,
        times=times,
        bounds=bounds,
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )
    name = "planners_development" if arguments.development else "planners_checked"
    cli.publish(arguments, f"{name}_{problem.id}", record)
    for text in (text_table(lines(record), CHECK_COLUMNS), text_table(times, TIME_COLUMNS)):
        cli.say(text)
    if bounds:
        cli.say(text_table(bounds, BOUND_COLUMNS))


if __name__ == "__main__":
    cli.run(main, continues=True)
