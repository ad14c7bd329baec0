"""What a margin on the obstacle costs and gives: networks asked for larger spheres, on the development set.

Each network plans for spheres that are larger by each of a few margins, and is judged by the true ones: mean violation
at the knots and over the whole path, and cost against the tracked optimum. Writes ``results/margin_<env>.json`` and
``.png``; the margin of the comparison's extra rows (``moe_policy/experiments/benchmark``) is chosen from it.

    python scripts/choose_margin.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from tqdm import tqdm

import moe_policy
import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, run
from moe_policy.experiments.figures.space import margins_figure
from moe_policy.experiments.methods import Method
from moe_policy.experiments.tables import keyed, text_table
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.stored import StoredPlans
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
MARGINS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="QuadcopterObstacle-v0", help="name of the environment")
    parser.add_argument("--parameter", default="radius", help="the parameter that is enlarged")
    parser.add_argument("--cases", type=int, help="development starts; all by default")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    torch.set_num_threads(1)  # the networks are far too small for more
    problem = ocp_envs.load(arguments.env)
    samples = ocp_envs.Database.open(arguments.data / problem.id / "development.zarr", problem).samples()
    samples = samples[: arguments.cases]
    optimal = Method("optimal", StoredPlans(samples.parameters, samples.trajectory))
    row, baseline = run(problem, optimal, samples.parameters, batches=())
    rows = [{"margin": None} | row]
    planners = [moe_policy.load(problem.id, name) for name in benchmark_of(problem).planners.compared]
    for planner, margin in tqdm([(p, m) for p in planners for m in MARGINS], unit="run", disable=None):
        method = Method(planner.name, WithMargin(problem, planner, arguments.parameter, margin))
        row, _ = run(problem, method, samples.parameters, baseline=baseline, batches=())
        rows.append({"margin": margin} | row)
    record = {"env_id": problem.id, "split": "development", "parameter": arguments.parameter, "cases": len(samples)}
    write_json(arguments.results / f"margin_{problem.id}.json", record | {"rows": rows, "provenance": provenance()})
    margins_figure(arguments.results / f"margin_{problem.id}.png", rows)
    print(text_table(rows, (keyed("margin", "margin", "g"), *COLUMNS)))


if __name__ == "__main__":
    main()
