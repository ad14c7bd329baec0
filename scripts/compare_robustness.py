"""Success under a plant that differs from the model: mismatch, disturbances, measurement noise, control delay.

The tracked optimum, nearest neighbour, networks, reinforcement learners and the stabiliser run from the first
validation starts, on plants that differ in one respect at a time (``moe_policy/robustness.py``), through the common
rollout loop. Each level is kept under ``data/robustness/<env>``, so that an interrupted command goes on. Writes
``results/robustness_<env>.json`` and ``.png``.

    python scripts/compare_robustness.py --env PendulumSwingup-v0
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from concurrent.futures import as_completed
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import moe_policy
import ocp_envs
from moe_policy.comparison import Contestant
from moe_policy.contestants import shipped, solve_all, stabiliser
from moe_policy.robustness import Perturbation, perturbations_of, run_level
from moe_policy.robustness_figures import robustness_figure
from ocp_envs import reference
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.records import provenance, write_json
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory
from ocp_envs.workers import WorkerPool

ROOT = Path(__file__).resolve().parents[1]


def fingerprint(problem: OptimalControlProblem, starts: Array, seed: int) -> str:
    """Of all that the figures of a level depend on, apart from the level."""
    models = {name: moe_policy.load(problem.id, name) for name in moe_policy.available(problem.id)}
    described = {name: str(getattr(model, "details", name)) for name, model in models.items()}
    sha = hashlib.sha256(json.dumps([problem.fingerprint, described, seed], sort_keys=True).encode())
    sha.update(np.ascontiguousarray(starts).tobytes())
    return sha.hexdigest()[:10]


@lru_cache(maxsize=1)
def contestants(env_id: str) -> list[Contestant]:
    problem = ocp_envs.load(env_id)
    return [*shipped(problem), *stabiliser(problem)]


def work(
    env_id: str, starts: Array, flat: Array, perturbation: Perturbation, level: float, seed: int, path: Path
) -> list[dict[str, Any]]:
    """Run one level and keep it."""
    torch.set_num_threads(1)
    problem = ocp_envs.load(env_id)
    optimal = Trajectory.from_flat(flat, problem.knots, problem.system.nx, problem.system.nu)
    everyone = [Contestant("optimal", lambda p: optimal), *contestants(env_id)]
    rows = run_level(problem, everyone, starts, perturbation, level, seed=seed)
    write_json(path, {"rows": rows})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--cases", type=int, default=1000, help="validation starts")
    parser.add_argument("--seed", type=int, default=0, help="of noise and disturbances")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of what is kept")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    began = time.perf_counter()
    problem = ocp_envs.load(arguments.env)
    starts = reference.load(problem, "validation").parameters[: arguments.cases]
    kept = arguments.data / "robustness" / problem.id / fingerprint(problem, starts, arguments.seed)
    levels = [(perturbation, level) for perturbation in perturbations_of(problem) for level in perturbation.levels]
    paths = {pair: kept / f"{pair[0].name}_{pair[1]:g}.json" for pair in levels}
    missing = [pair for pair in levels if not paths[pair].exists()]
    if missing:
        flat = solve_all(problem, starts, keep=arguments.data / "optimal" / problem.id)[0].flat()
        with WorkerPool(arguments.workers) as pool:
            futures = [
                pool.submit(work, problem.id, starts, flat, *pair, arguments.seed, paths[pair]) for pair in missing
            ]
            for future in tqdm(as_completed(futures), total=len(futures), unit="level", disable=None):
                future.result()
    rows = [row for path in paths.values() for row in json.loads(path.read_text())["rows"]]
    record = {
        "env_id": problem.id,
        "cases": len(starts),
        "seed": arguments.seed,
        "perturbations": [
            {"name": p.name, "label": p.label, "kind": p.kind, "levels": p.levels, "names": p.names}
            for p in perturbations_of(problem)
        ],
        "rows": rows,
        "seconds": time.perf_counter() - began,
    }
    write_json(arguments.results / f"robustness_{problem.id}.json", record | {"provenance": provenance()})
    robustness_figure(arguments.results / f"robustness_{problem.id}.png", rows, perturbations_of(problem))
    print(f"{len(levels)} levels of {problem.id}, {record['seconds']:.0f} s")


if __name__ == "__main__":
    main()
