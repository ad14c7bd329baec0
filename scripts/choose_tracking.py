"""Choose tracking weights: a grid of weights on the development set.

The stored optimal trajectories and the plans of every planner are tracked with Q = I (gains depend on ratios alone),
R = r I, the terminal weight s I (or that of the infinite horizon) and control authority ρ. Costs are relative to the
optimal plans tracked with the same weights. The weights that are chosen from the table are in
``moe_policy/control/lqr.py``. Writes ``tracking_<env>.json``.

    python scripts/choose_tracking.py --env Quadcopter-v0
"""

import itertools
from pathlib import Path

import moe_policy
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, TrackingChoice, TrackingRow, run
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.reports.tables import Column, text_table
from moe_policy.score.method import Method
from moe_policy.store import load_file
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance

CONTROL, TERMINAL, ROOM = (0.01, 0.1, 1.0, 10.0), (None, 1e3, 1e4, 1e5), (1.0, 0.1)
TRACKING_COLUMNS: tuple[Column[TrackingRow], ...] = (
    Column("r", lambda row: row.control, "g"),
    Column("s", lambda row: row.terminal, "g"),
    Column("ρ", lambda row: row.room, "g"),
    *(column.of_part(lambda row: row.row) for column in COLUMNS),
)


def planners_of(problem: OptimalControlProblem, paths: list[Path] | None) -> list[Method]:
    """The planners saved at ``paths``; without any, the compared ones in the package."""
    if paths:
        planners = [load_file(path, problem, kind=NetworkPlanner) for path in paths]
    else:
        names = benchmark_of(problem).planners.compared
        planners = [moe_policy.load(problem, name, kind=NetworkPlanner) for name in names]
    return [Method(planner.name, planner) for planner in planners]


def main() -> None:
    parser = cli.parser(__doc__, env="Quadcopter-v0", data=True, cases="development instances")
    parser.add_argument("--planners", metavar="PATH", type=Path, nargs="+", help="saved planners; shipped by default")
    arguments = parser.parse()
    cli.threads()
    problem = arguments.problem
    samples = cli.database(arguments, "development").samples()
    cli.at_most(arguments.cases, len(samples), "solved development instances")
    samples = samples[: arguments.cases]
    optimal = Method("optimal", StoredPlans(samples.parameters, samples.trajectory))
    methods = [optimal, *planners_of(problem, arguments.planners)]
    rows = []
    choices = [*itertools.product(CONTROL, TERMINAL, ROOM)]
    for r, s, room in track(choices, len(choices), unit="choice", label="weights"):
        weights, baseline = TrackingWeights.uniform(problem, 1.0, r, s, room), None
        for method in methods:
            row, episodes = run(problem, method, samples.parameters, baseline=baseline, weights=weights, batches=())
            baseline = baseline or episodes
            rows.append(TrackingRow(control=r, terminal=s, room=room, row=row))
    record = TrackingChoice(
        env_id=problem.id, split="development", cases=len(samples), rows=tuple(rows), provenance=provenance()
    )
    cli.publish(arguments, f"tracking_{problem.id}", record)
    print(text_table(rows, TRACKING_COLUMNS))


if __name__ == "__main__":
    cli.run(main)
