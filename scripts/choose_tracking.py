"""Which tracking weights bring plans of networks to the goal: a grid of weights on the development set.

Every planner, and the stored optimal trajectories beside them, is tracked from the development starts with Q = I (gains
depend on ratios alone), R = r I, the terminal weight s I (or the default one) and room ρ. Costs are compared with the
optimal plans tracked with the same weights. What is chosen from the table stands in ``moe_policy/lqr.py``. Writes
``results/tracking_<env>.json``.

    python scripts/choose_tracking.py --env Quadcopter-v0
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import torch
from tqdm import tqdm

import moe_policy
import ocp_envs
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, run
from moe_policy.experiments.methods import Method
from moe_policy.experiments.tables import keyed, text_table
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.store import load_file
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
CONTROL, TERMINAL, ROOM = (0.01, 0.1, 1.0, 10.0), (None, 1e3, 1e4, 1e5), (1.0, 0.1)
WEIGHTS = (keyed("control", "r", "g"), keyed("terminal", "s", "g"), keyed("room", "ρ", "g"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="Quadcopter-v0", help="name of the environment")
    parser.add_argument("--planners", type=Path, nargs="+", help="saved planners; by default the shipped ones compared")
    parser.add_argument("--cases", type=int, help="development starts; all by default")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    torch.set_num_threads(1)
    problem = ocp_envs.load(arguments.env)
    samples = ocp_envs.Database.open(arguments.data / problem.id / "development.zarr", problem).samples()
    samples = samples[: arguments.cases]
    if arguments.planners:
        planners = [load_file(path, problem, kind=NetworkPlanner) for path in arguments.planners]
    else:
        names = benchmark_of(problem).planners.compared
        planners = [moe_policy.load(problem, name, kind=NetworkPlanner) for name in names]
    optimal = Method("optimal", StoredPlans(samples.parameters, samples.trajectory))
    rows = []
    grid = list(itertools.product(CONTROL, TERMINAL, ROOM))
    for control, terminal, room in tqdm(grid, unit="weights", disable=None):
        weights = TrackingWeights.uniform(problem, 1.0, control, terminal, room)
        baseline = None
        for method in [optimal, *(Method(planner.name, planner) for planner in planners)]:
            row, episodes = run(problem, method, samples.parameters, baseline=baseline, weights=weights, batches=())
            baseline = baseline or episodes
            rows.append({"control": control, "terminal": terminal, "room": room} | row)
    record = {"env_id": problem.id, "split": "development", "cases": len(samples), "rows": rows}
    write_json(arguments.results / f"tracking_{problem.id}.json", record | {"provenance": provenance()})
    print(text_table(rows, (*WEIGHTS, *COLUMNS)))


if __name__ == "__main__":
    main()
