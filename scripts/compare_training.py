"""The paper's nine pendulum models over several training seeds, the ablation, and success against training size.

Every trained model is evaluated on the validation set. Runs are spread over the cores, each result is kept under
``data/compare_training/``, and an interrupted command goes on where it stopped; ``--fresh`` starts over. Needs the
databases of ``scripts/generate_data.py``. Writes ``results/compare_training_<env>.json`` and figures beside it.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import ocp_envs
from moe_policy import comparison, figures, recipes
from moe_policy.architectures import PENDULUM_ABLATION, layer_sizes
from moe_policy.clustering import cluster
from moe_policy.fitting import DEFAULT, PAPER, TrainingSettings
from moe_policy.planner import NetworkPlanner
from moe_policy.store import load_file
from moe_policy.training import fit_single
from ocp_envs.database import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.records import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
ENV_ID = "PendulumSwingup-v0"
#: Validation error and successes of 1000 in Tang & Hauser, table II.
PAPERS_TABLE: dict[str, tuple[float, int]] = {
    "snn": (0.046, 717),
    "moe-custom": (0.030, 998),
    "moe-random": (0.035, 829),
    "moe-kmeans-3": (0.039, 970),
    "moe-kmeans-4": (0.029, 1000),
    "moe-kmeans-10": (0.051, 1000),
    "moe-retrained-argmax": (0.027, 941),
    "moe-retrained-softmax-1": (0.028, 896),
    "moe-retrained-softmax-0.1": (0.026, 969),
}
#: Test errors of the single networks in section III-E, by hidden layers.
PAPERS_ABLATION = {(300,): 0.058, (50, 20): 0.258, (20, 50): 0.170, (30, 30, 30): 0.232}
SIZED = ("snn", "moe-custom", "moe-kmeans-4")
SIZES = (80, 160, 320, 640, 1281)
#: Seeds of the ablation and of the smaller training sets.
FEWER_SEEDS = 3


@dataclass(frozen=True)
class Run:
    """One training: a recipe (or the hidden layers of a single network), its settings, seed and number of samples."""

    name: str
    seed: int
    samples: int
    settings: TrainingSettings = DEFAULT
    hidden: tuple[int, ...] | None = None

    @property
    def key(self) -> str:
        layers = "" if self.hidden is None else "-" + "-".join(map(str, self.hidden))
        return f"{self.name}{layers}{'-paper' if self.settings == PAPER else ''}-n{self.samples}-s{self.seed}"


def plan(seeds: int, total: int) -> Iterator[Run]:
    for seed in range(seeds):
        for name in (*PAPERS_TABLE, "moe-kmeans-pca-4"):
            yield Run(name, seed, total)
        for name in ("snn", "moe-custom"):
            yield Run(name, seed, total, PAPER)
    for seed in range(min(seeds, FEWER_SEEDS)):
        for hidden in PENDULUM_ABLATION:
            yield Run("snn", seed, total, hidden=hidden)
        for size in SIZES:
            if size < total:
                yield from (Run(name, seed, size) for name in SIZED)


def select(samples: Samples, count: int, seed: int) -> Samples:
    return samples[np.sort(np.random.default_rng(seed).permutation(len(samples))[:count])]


def execute(run: Run, data: Path, work: Path) -> dict[str, Any]:
    """Train, evaluate on the validation set and keep the record."""
    torch.set_num_threads(1)
    problem = ocp_envs.load(ENV_ID)
    training = ocp_envs.Database.open(data / "training.zarr", problem).samples()
    validation = ocp_envs.Database.open(data / "validation.zarr", problem).samples()
    samples = training if run.samples == len(training) else select(training, run.samples, run.seed)
    planner: NetworkPlanner
    if run.hidden is None:
        planner = recipes.make(run.name, samples, settings=run.settings, seed=run.seed)  # type: ignore[assignment]
    else:
        planner = fit_single(samples, settings=run.settings, seed=run.seed, sizes=layer_sizes(problem, run.hidden))
    planner.save(work / "models" / run.key)
    contestant = comparison.Contestant(run.name, planner)
    row, _ = comparison.run(problem, contestant, validation.parameters, optimal=validation.trajectory, batches=())
    record = {
        "seed": run.seed,
        "samples": run.samples,
        "success": row["success"]["count"],
        "success_at_plan_end": row["success_at_plan_end"]["count"],
        "test_error": row["test_error"],
        "validation_error": row["validation_error"],
        "training_seconds": planner.details["training"]["seconds"],
    }
    write_json(work / f"{run.key}.json", record)
    return record


def run_all(runs: list[Run], data: Path, work: Path, workers: int | None) -> dict[Run, dict[str, Any]]:
    records = {r: json.loads(path.read_text()) for r in runs if (path := work / f"{r.key}.json").exists()}
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(execute, run, data, work): run for run in runs if run not in records}
        for future in tqdm(as_completed(futures), total=len(futures), unit="model", disable=None):
            records[futures[future]] = future.result()
    return records


def spread(values: list[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "least": min(values), "most": max(values)}


def row_of(name: str, records: list[dict[str, Any]]) -> dict[str, Any]:
    row: dict[str, Any] = {"name": name, "samples": records[0]["samples"], "seeds": [r["seed"] for r in records]}
    for key in ("success", "success_at_plan_end", "test_error", "validation_error", "training_seconds"):
        row[key] = [r[key] for r in records]
        row[f"{key}_spread"] = spread(row[key])
    return row


def assemble(records: dict[Run, dict[str, Any]], total: int) -> dict[str, Any]:
    def collect(
        name: str, samples: int = total, settings: TrainingSettings = DEFAULT, hidden: Any = None
    ) -> dict[str, Any]:
        chosen = [r for r in records if (r.name, r.samples, r.settings, r.hidden) == (name, samples, settings, hidden)]
        return row_of(name, [records[r] for r in sorted(chosen, key=lambda r: r.seed)])

    rows = []
    for name, (error, success) in PAPERS_TABLE.items():
        rows.append(collect(name) | {"paper_validation_error": error, "paper_success": success})
    rows.append(collect("moe-kmeans-pca-4"))
    for name in ("snn", "moe-custom"):
        rows.append(collect(name, settings=PAPER) | {"name": f"{name}, the paper's training settings"})
    ablation = [
        collect("snn", hidden=None if hidden == (300,) else hidden)
        | {"hidden": list(hidden), "paper_test_error": error}
        for hidden, error in PAPERS_ABLATION.items()
    ]
    sizes = [collect(name, size) for name in SIZED for size in SIZES if size <= total]
    return {"rows": rows, "ablation": ablation, "sizes": sizes}


def draw(
    problem: OptimalControlProblem, data: Path, work: Path, results: Path, record: dict[str, Any]
) -> dict[str, Any]:
    training = ocp_envs.Database.open(data / "training.zarr", problem).samples()
    validation = ocp_envs.Database.open(data / "validation.zarr", problem).samples()
    partitions = {"custom": cluster(training, "custom")}
    partitions |= {f"k-means {k}": cluster(training, "kmeans", k=k) for k in (3, 4, 10)}
    stem = f"training_{problem.id}"
    figures.clusters_figure(results / f"{stem}_clusters.png", training, partitions)
    figures.sizes_figure(results / f"{stem}_sizes.png", record["sizes"], len(validation))

    costs = np.sort(validation.mode_costs, axis=1)
    gap = costs[:, 1] / costs[:, 0] - 1
    chosen = int(gap.argmin())
    p = validation.parameters[chosen : chosen + 1]
    planners = {name: load_file(work / "models" / Run(name, 0, len(training)).key, problem) for name in PAPERS_TABLE}
    plans = {name: planners[name](p) for name in ("snn", "moe-custom")}
    optimal = validation.trajectory[chosen]
    figures.discontinuity_figure(results / f"{stem}_jump.png", training, partitions["custom"], optimal, plans)

    errors = {}
    for name, planner in planners.items():
        _, episodes = comparison.run(problem, comparison.Contestant(name, planner), validation.parameters, batches=())
        errors[name] = (problem.goal_error(planner(validation.parameters).states[:, -1]), episodes.final_error)
    figures.error_figure(results / f"{stem}_errors.png", errors, problem.goal.radius)
    return {
        "clusters": {name: labels.sizes.tolist() for name, labels in partitions.items()},
        "jump": {"parameters": p[0].tolist(), "relative_cost_of_the_second_mode": float(gap[chosen])},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="training seeds of every model")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--fresh", action="store_true", help="forget the models of earlier runs")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    began = time.perf_counter()
    problem = ocp_envs.load(ENV_ID)
    data, work = arguments.data / problem.id, arguments.data / "compare_training" / problem.id
    if arguments.fresh:
        shutil.rmtree(work, ignore_errors=True)
    total = len(ocp_envs.Database.open(data / "training.zarr", problem).samples())
    records = run_all(list(plan(arguments.seeds, total)), data, work, arguments.workers)
    record = assemble(records, total)
    record |= draw(problem, data, work, arguments.results, record)
    record |= {"env_id": problem.id, "seconds": time.perf_counter() - began, "provenance": provenance()}
    write_json(arguments.results / f"compare_training_{problem.id}.json", record)
    for row in record["rows"]:
        medians = [row[f"{key}_spread"]["median"] for key in ("success", "success_at_plan_end")]
        print(f"{row['name']:45s} {medians[0]:6.0f} {medians[1]:6.0f}")


if __name__ == "__main__":
    main()
