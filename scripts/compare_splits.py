"""Compare optimal control, networks, mixtures, reinforcement learning and the stabiliser on hard instances.

All run from the same initial conditions through the same rollout loop: those of ``uniform`` (the validation set),
``boundary`` (near the discontinuity of the optimum), ``near`` (near the goal) and ``outside`` (outside the parameter
box), as far as the problem has them; ``scripts/make_splits.py`` makes the hard ones. With ``--seeds`` also the networks
that ``scripts/compare_training.py`` trained with several seeds, all with equal settings. Writes
``compare_splits_<env>.json``, with the curves over the distance from the discontinuity, and the picture
``splits_<env>.png``. The pendulum takes about two minutes. With ``--names`` those
methods alone, whose rows replace those of ``results/`` or are added to them.

    python scripts/compare_splits.py --env GroundVehicle-v0
    python scripts/compare_splits.py --env GroundVehicle-v0 --names moe-auto --seeds 3
    python scripts/compare_splits.py --cases 100
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.experiments import cli, trainings
from moe_policy.experiments.comparison import run, track_optimum
from moe_policy.experiments.distances import DistanceCurves
from moe_policy.experiments.figures.generalisation import splits_figure
from moe_policy.experiments.methods import named, shipped, stabiliser
from moe_policy.experiments.splits import (
    BINNED,
    CostDifferenceRange,
    SeedsRow,
    SplitComparison,
    SplitMethod,
    SplitRow,
    SplitSummary,
    lines,
    separations,
)
from moe_policy.experiments.trainings import Run
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import ABSENT, read
from moe_policy.reports.split_table import SPLIT_COLUMNS
from moe_policy.reports.tables import text_table
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.metrics import Metrics
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.discontinuity import discontinuity_of
from ocp_envs.sets.reference import SPLITS, ReferenceSet
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance

#: Number of instances of a split, the first ones, on which the networks of several seeds are compared.
SEED_CASES = 2_000


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was found on one split; rows and episodes by method."""

    cases: ReferenceSet
    summary: SplitSummary
    rows: dict[str, SplitRow]
    episodes: dict[str, Episodes]
    seeds: dict[Run, Metrics]  # of the networks that were trained with several seeds


def compare_on(
    problem: OptimalControlProblem,
    methods: Sequence[Method],
    networks: Mapping[Run, NetworkPlanner],
    split: str,
    cases: ReferenceSet,
    data: Path,
) -> Outcome:
    """The optimum, all ``methods`` and the ``networks`` of several seeds on the ``cases`` of one ``split``.

    Solutions are kept in the folder ``data``.
    """
    p = cases.parameters
    optimum = track_optimum(problem, p, cases.cost, shipped(problem), data / "optimal" / problem.id)
    episodes = {"optimal": optimum.episodes}
    rows = {"optimal": SplitRow.of(problem, optimum.row, optimum.episodes)}
    for method in track(methods, len(methods), unit="method", label=split, leave=False):
        row, made = run(problem, method, p, baseline=optimum.baseline, batches=())
        rows[method.name], episodes[method.name] = SplitRow.of(problem, row, made), made
        cli.say(f"{split}, {method.name}: {row.metrics.success.count} of {len(cases)}")
    seeds = {}
    few, baseline = p[:SEED_CASES], optimum.baseline[:SEED_CASES]
    for training, planner in track(networks.items(), len(networks), unit="network", label=split, leave=False):
        row, _ = run(problem, Method(training.name, planner), few, baseline=baseline, batches=())
        seeds[training] = row.metrics
        cli.say(f"{split}, {training.name}, seed {training.seed}: {row.metrics.success.count} of {len(few)}")
    solved = np.isfinite(optimum.costs)
    summary = SplitSummary(
        cases=len(cases),
        optimal_solved=int(solved.sum()),
        reference_difference=CostDifferenceRange.of(optimum.costs[solved], cases.cost[solved]),
        separations=separations(problem, rows),
    )
    return Outcome(cases, summary, rows, episodes, seeds)


def seed_rows(networks: Mapping[Run, NetworkPlanner], outcomes: Mapping[str, Outcome]) -> tuple[SeedsRow, ...]:
    """One row for each kind of network, over its seeds."""
    rows = []
    for name in dict.fromkeys(training.name for training in networks):
        runs = [training for training in networks if training.name == name]
        rows.append(SeedsRow.of(runs, {split: [o.seeds[one] for one in runs] for split, o in outcomes.items()}))
    return tuple(rows)


def curves_of(problem: OptimalControlProblem, outcomes: Mapping[str, Outcome]) -> DistanceCurves | None:
    """The curves over the distance from the discontinuity; ``None`` without instances near it."""
    discontinuity = discontinuity_of(problem)
    if "boundary" not in outcomes or discontinuity is None:
        return None
    used = [outcome for split, outcome in outcomes.items() if split in BINNED]
    distances = [discontinuity.distance(problem, o.cases.parameters, o.cases.mode_costs) for o in used]
    episodes = {name: Episodes.concatenate([outcome.episodes[name] for outcome in used]) for name in used[0].episodes}
    return DistanceCurves.of(problem, np.concatenate(distances), episodes)


def compare(
    problem: OptimalControlProblem,
    methods: Sequence[Method],
    networks: Mapping[Run, NetworkPlanner],
    splits: Sequence[str],
    count: int | None,
    data: Path,
) -> SplitComparison:
    """The record of ``methods`` and ``networks`` on the first ``count`` instances, or all, of each of ``splits``.

    Solutions are kept in the folder ``data``.
    """
    began = time.perf_counter()
    sets = {split: reference.load(problem, SPLITS[split]) for split in splits}
    cli.at_most(count, max(map(len, sets.values())), "instances in the largest split")
    outcomes = {
        split: compare_on(problem, methods, networks, split, cases[:count], data) for split, cases in sets.items()
    }
    names = ["optimal", *(method.name for method in methods)]
    return SplitComparison(
        env_id=problem.id,
        splits={split: outcome.summary for split, outcome in outcomes.items()},
        rows=tuple(
            SplitMethod(name=name, splits={split: outcome.rows[name] for split, outcome in outcomes.items()})
            for name in names
        ),
        seeds=seed_rows(networks, outcomes) or ABSENT,
        curves=curves_of(problem, outcomes),
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )


def main() -> None:
    parser = cli.parser(__doc__, data=True, cases="instances of every split, at most")
    parser.add_argument("--splits", nargs="+", choices=SPLITS, help="which; all by default")
    parser.add_argument(
        "--seeds",
        metavar="N",
        type=cli.positive,
        help="compare networks of N seeds of scripts/compare_training.py, too",
    )
    parser.add_argument(
        "--names",
        nargs="+",
        metavar="NAME",
        help="shipped methods whose rows are replaced or added",
    )
    arguments = parser.parse()
    cli.threads()
    problem = arguments.problem
    there = [split for split, name in SPLITS.items() if name == "validation" or name in sets_of(problem).hard]
    if missing := [split for split in arguments.splits or () if split not in there]:
        parser.error(f"argument --splits: {problem.id} has no {missing[0]!r}; there are {', '.join(there)}")
    names, seeds, name = arguments.names, arguments.seeds, f"compare_splits_{problem.id}"
    networks = {} if seeds is None else trainings.networks(problem, arguments.data, seeds, names)
    methods = (
        [*shipped(problem, cli.RECORDS), *stabiliser(problem)] if names is None else named(problem, names, cli.RECORDS)
    )
    record = compare(problem, methods, networks, arguments.splits or there, arguments.cases, arguments.data)
    if names is not None:
        with cli.option("--names"):
            record = read(cli.RECORDS / f"{name}.json", SplitComparison).with_rows(record, names)
    cli.publish(arguments, name, record)
    figure = splits_figure(arguments.results / f"splits_{problem.id}.png", problem, record)
    cli.say(f"\n{text_table(lines(record), SPLIT_COLUMNS)}")
    cli.say(f"{record.seconds:.0f} s; wrote {figure}")


if __name__ == "__main__":
    cli.run(main, continues=True)
