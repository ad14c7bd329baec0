"""The quadcopter under the other reading of its cost: are the conclusions the same?

The paper prints the state weights for (position, velocity, angles, rates), while the program it describes orders states
as (position, angles, velocity, rates): the weights 1 of the velocity and 0.1 of the angles may be swapped. Here the
problem with swapped weights is generated, learnt and tracked as ``Quadcopter-v0`` is, from the same starts and with the
same settings. Databases go to ``data/QuadcopterSwapped-v0/``, where an interrupted run goes on. Writes
``results/sensitivity_Quadcopter-v0.json``.

    python scripts/check_sensitivity.py
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch

import ocp_envs
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, run
from moe_policy.experiments.methods import Method
from moe_policy.experiments.tables import text_table
from moe_policy.learning import recipes
from moe_policy.planners.stored import StoredPlans
from ocp_envs.problems.quadcopter import QUADCOPTER, cost_rate
from ocp_envs.sets.splits import split_of
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]


def swapped_rate(state: Sequence[Any], control: Sequence[Any], context: SimpleNamespace, c: SimpleNamespace) -> Any:
    """The cost rate with the weights of velocity and angles exchanged."""
    return cost_rate([*state[:3], *state[6:9], *state[3:6], *state[9:]], control, context, c)


SWAPPED = dataclasses.replace(QUADCOPTER, id="QuadcopterSwapped-v0", cost_rate=swapped_rate)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    arguments = parser.parse_args()

    torch.set_num_threads(1)
    ocp_envs.register(SWAPPED)
    benchmark, weights = benchmark_of(QUADCOPTER), TrackingWeights.default(QUADCOPTER)
    databases = {}
    for name in ("training", "validation"):
        split = split_of(QUADCOPTER, name)
        path = arguments.data / SWAPPED.id / f"{name}.zarr"
        databases[name] = ocp_envs.generate(
            SWAPPED,
            path,
            split.parameters(QUADCOPTER),
            seed=split.seed,
            settings=split.settings,
            workers=arguments.workers,
        )
        print(f"{name}: {databases[name].totals()}", flush=True)
    training, validation = databases["training"].samples(), databases["validation"].samples()
    p, optimal = validation.parameters, validation.trajectory
    row, baseline = run(SWAPPED, Method("optimal", StoredPlans(p, optimal)), p, weights=weights, batches=())
    rows = [row]
    for name in benchmark.planners.compared:
        with WorkerPool(arguments.workers) as pool:
            planner: Any = recipes.make(name, training, settings=benchmark.training.settings, executor=pool)
        method = Method(name, planner, f"{len(training):,} solutions", planner.details["training"]["seconds"])
        row, _ = run(SWAPPED, method, p, optimal=optimal, baseline=baseline, weights=weights, batches=())
        rows.append(row)
        print(f"{name}: {row['success']['count']} of {len(p)}", flush=True)
    record = {"env_id": SWAPPED.id, "cases": len(p), "rows": rows, "provenance": provenance()}
    write_json(arguments.results / f"sensitivity_{QUADCOPTER.id}.json", record)
    print(text_table(rows, COLUMNS))


if __name__ == "__main__":
    main()
