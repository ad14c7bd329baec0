"""Success on a plant that differs from the model: mismatch, disturbances, measurement noise, control delay.

The tracked optimum, nearest neighbour, networks, reinforcement learners and the stabiliser run from the first
validation starts, on plants that differ in one respect at a time (``moe_policy/robustness.py``), through the common
rollout loop; all plan with the nominal model. Optimal trajectories are solved once and kept in ``data/optimal/<env>``,
what each level gave in ``data/robustness/<env>``, so that an interrupted command goes on; what is kept counts for its
problem, models, starts, seed, plant and package versions alone (after a change of the program, delete it). Writes
``results/robustness_<env>.json`` and ``.png``.

    python scripts/compare_robustness.py --env GroundVehicle-v0
    python scripts/compare_robustness.py --cases 50 --results /tmp
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import ocp_envs
from moe_policy import store
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.figures.robustness import robustness_figure
from moe_policy.experiments.methods import Method, shipped, solve_all, stabiliser
from moe_policy.experiments.perturbations import Perturbation
from moe_policy.experiments.robustness import level_key, run_level
from moe_policy.experiments.tables import keyed, text_table
from moe_policy.planners.stored import StoredPlans
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.arrays import Array
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
DT = 0.02
#: Starts where ``--cases`` is not given: a fifth of the validation set, but not fewer than so many.
LEAST = 1000


@lru_cache(maxsize=1)
def methods(problem: OptimalControlProblem) -> list[Method]:
    """Everybody but the optimum."""
    return [*shipped(problem), *stabiliser(problem)]


def identity(problem: OptimalControlProblem, starts: Array, optimal: Array, seed: int) -> str:
    """A hash of all that the figures of a level depend on, the level apart; ``optimal`` are flat trajectories."""
    sha = hashlib.sha256()
    weights = {key: str(value) for key, value in asdict(TrackingWeights.default(problem)).items()}
    sha.update(json.dumps([problem.fingerprint, seed, DT, weights, provenance().versions]).encode())
    for method in methods(problem):
        sha.update(method.name.encode())
        description = store.SHIPPED / problem.id / f"{method.name}.json"  # carries the hash of the tensors
        sha.update(description.read_bytes() if description.exists() else b"")
    for array in (starts, optimal):
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def work(env_id: str, starts: Array, flat: Array, arguments: Mapping[str, Any], seed: int, path: Path) -> None:
    """Run everybody on one plant and keep how they did."""
    torch.set_num_threads(1)  # the networks are far too small for more
    began = time.process_time()
    problem = ocp_envs.load(env_id)
    optimal = problem.unflatten(flat)
    everyone = [Method("optimal", StoredPlans(starts, optimal)), *methods(problem)]
    rows = run_level(problem, everyone, starts, arguments, seed=seed, dt=DT)
    write_json(path, {"arguments": arguments, "rows": rows, "cpu_seconds": time.process_time() - began})


def tables(rows: Sequence[Mapping[str, Any]], perturbations: Sequence[Perturbation]) -> str:
    """Successes of each method by level, one table for each perturbation."""
    parts = []
    for perturbation in perturbations:
        shown = [row for row in rows if row["perturbation"] == perturbation.name]
        lines = [
            {"name": name} | {f"{row['level']:g}": row["success"]["count"] for row in shown if row["name"] == name}
            for name in dict.fromkeys(row["name"] for row in shown)
        ]
        levels = [keyed(f"{level:g}", f"{level:g}") for level in perturbation.levels]
        parts.append(text_table(lines, [keyed("name", f"{perturbation.name}, {perturbation.unit}"), *levels]))
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--cases", type=int, help="validation starts; a fifth of them, 1,000 at least, by default")
    parser.add_argument("--seed", type=int, default=0, help="of noise and disturbances, the same for every level")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of what is kept")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    problem = ocp_envs.load(arguments.env)
    perturbations = benchmark_of(problem).perturbations
    validation = reference.load(problem, "validation").parameters
    starts = validation[: arguments.cases or max(LEAST, len(validation) // 5)]
    flat = solve_all(problem, starts, keep=arguments.data / "optimal" / problem.id)[0].flat()
    who, kept = identity(problem, starts, flat, arguments.seed), arguments.data / "robustness" / problem.id
    plants = {(p.name, level): p.arguments(problem, level, DT) for p in perturbations for level in p.levels}
    paths = {key: kept / f"{level_key(who, plant)}.json" for key, plant in plants.items()}
    # The nominal plants of all perturbations are one.
    missing = {path: plants[key] for key, path in paths.items() if not path.exists()}
    with WorkerPool(arguments.workers) as pool:
        futures = [
            pool.submit(work, problem.id, starts, flat, plant, arguments.seed, path) for path, plant in missing.items()
        ]
        for future in tqdm(as_completed(futures), total=len(futures), unit="level", disable=None):
            future.result()

    found = {path: json.loads(path.read_text()) for path in paths.values()}
    rows = [
        {"perturbation": name, "level": level} | row
        for (name, level), path in paths.items()
        for row in found[path]["rows"]
    ]
    record = {
        "env_id": problem.id,
        "cases": len(starts),
        "seed": arguments.seed,
        "dt": DT,
        "perturbations": [asdict(perturbation) for perturbation in perturbations],
        "rows": rows,
        "cpu_seconds": sum(level["cpu_seconds"] for level in found.values()),
        "provenance": provenance(),
    }
    path = arguments.results / f"robustness_{problem.id}.json"
    write_json(path, record)
    robustness_figure(path.with_suffix(".png"), rows, perturbations)
    print(f"{tables(rows, perturbations)}\n{record['cpu_seconds']:.0f} s of one core; written to {path} and .png")


if __name__ == "__main__":
    main()
