"""Train the planners of an environment from its training database, and ship them.

The planners go to ``moe_policy/models/<env-id>/``. Run ``scripts/generate_data.py`` first.

    python scripts/train_planners.py
    python scripts/train_planners.py --names snn moe-custom --seed 1 --models /tmp/models
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import torch

import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.learning import recipes
from moe_policy.store import SHIPPED
from ocp_envs.support.pool import WorkerPool

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--names", nargs="+", help="which planners, see moe_policy/recipes.py; all of the benchmark")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--models", type=Path, default=SHIPPED, help="folder of the models")
    parser.add_argument("--seed", type=int, default=0, help="seed of clustering and training")
    parser.add_argument("--workers", type=int, help="processes that train the networks of a mixture; one per core")
    arguments = parser.parse_args()

    torch.set_num_threads(1)  # the networks are far too small for more
    problem = ocp_envs.load(arguments.env)
    benchmark = benchmark_of(problem)
    database = ocp_envs.Database.open(arguments.data / problem.id / "training.zarr", problem)
    samples = database.samples(database.first(benchmark.training.instances))
    with WorkerPool(arguments.workers) as pool:
        for name in arguments.names or ("nearest", *benchmark.planners.trained):
            began = time.perf_counter()
            chosen = samples[: benchmark.planners.stored] if name == "nearest" else samples
            planner = recipes.make(
                name, chosen, settings=benchmark.training.settings, seed=arguments.seed, executor=pool
            )
            planner.save(arguments.models / problem.id / name)
            print(f"{name}: {len(chosen)} samples, {time.perf_counter() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main()
