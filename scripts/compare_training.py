"""The planners of a study over several training seeds, ablations, and success against training size.

Every trained model is evaluated on the validation set. Runs are spread over the cores, each result is kept under
``data/compare_training/``, and an interrupted command goes on where it stopped; a result counts for its database and
settings alone. Needs the databases of ``scripts/generate_data.py``. Writes ``results/compare_training_<env>.json`` and
figures beside it. What is trained stands in ``moe_policy/studies.py``.

    python scripts/compare_training.py --env GroundVehicle-v0 --seeds 3
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import time
from collections.abc import Iterator
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import ocp_envs
from moe_policy import comparison, figures, recipes, space_figures, trajectory_figures
from moe_policy.architectures import PAPER_SIZES, layer_sizes
from moe_policy.cases import plan_violations
from moe_policy.clustering import cluster
from moe_policy.fitting import PAPER, TrainingSettings
from moe_policy.lqr import TrackingWeights
from moe_policy.planner import NearestPlanner, NetworkPlanner
from moe_policy.store import SHIPPED, load_file
from moe_policy.studies import Study, study_of
from moe_policy.training import fit_single
from ocp_envs.database import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.records import provenance, write_json
from ocp_envs.workers import WorkerPool

ROOT = Path(__file__).resolve().parents[1]
#: All problems of the training set.
WHOLE = "whole"
#: Training samples drawn around the case where the single network interpolates.
NEIGHBOURS = 8


def short_hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]


@dataclass(frozen=True)
class Run:
    """One training: a recipe (or the hidden layers of a single network), its settings, seed and number of samples."""

    name: str
    seed: int
    samples: int
    settings: TrainingSettings
    hidden: tuple[int, ...] | None = None

    def key(self, data: str) -> str:
        """Name of its files; ``data`` is the key of the training database."""
        layers = "" if self.hidden is None else "-" + "-".join(map(str, self.hidden))
        record = json.dumps([data, dataclasses.asdict(self.settings)], sort_keys=True)
        return f"{self.name}{layers}-n{self.samples}-s{self.seed}-{short_hash(record)}"


@dataclass(frozen=True)
class Folders:
    """Where databases lie and where models and their records go."""

    data: Path
    work: Path

    def model(self, key: str) -> Path:
        return self.work / "models" / key

    def record(self, problem: OptimalControlProblem, key: str) -> Path:
        """The record of a model, which depends on how its plans are tracked."""
        weights = dataclasses.asdict(TrackingWeights.default(problem))
        tracking = json.dumps({k: np.array(v).tolist() for k, v in weights.items()}, sort_keys=True)
        return self.work / f"{key}-{short_hash(tracking)}.json"

    @lru_cache(maxsize=4)  # noqa: B019 - one for each process
    def samples(self, problem: OptimalControlProblem, name: str) -> Samples:
        """A split; of the training set the problems that the study trains on, unless it is asked for as ``WHOLE``."""
        database = ocp_envs.Database.open(self.data / f"{'training' if name == WHOLE else name}.zarr", problem)
        return database.samples(database.first(study_of(problem).problems) if name == "training" else None)


def sizes_of(study: Study, total: int) -> list[tuple[int, TrainingSettings]]:
    """Numbers of training problems and the settings for them, the whole set last."""
    smaller = [(n, dataclasses.replace(study.settings, epochs=e)) for n, e in study.sizes.items() if n < total]
    return [*smaller, (total, study.settings)]


def plan(problem: OptimalControlProblem, study: Study, seeds: int, total: int) -> Iterator[Run]:
    """All runs, those of the first seed first."""
    for seed in range(seeds):
        for name in study.models:
            yield Run(name, seed, total, study.settings)
        for name in study.paper_settings:
            yield Run(name, seed, total, PAPER)
        if seed >= study.fewer_seeds:
            continue
        for hidden in study.ablation:
            if hidden != PAPER_SIZES[problem.id].single:
                yield Run("snn", seed, total, study.settings, hidden)
        for size, settings in sizes_of(study, total):
            yield from (Run(name, seed, size, settings) for name in study.sized if size < total)


def plan_whole(study: Study, database: ocp_envs.Database, total: int) -> Iterator[Run]:
    """The runs on all problems, where the others are on fewer and the database is complete."""
    if study.whole is not None and database.complete and (count := database.totals()["solved"]) > total:
        yield from (Run(name, 0, count, study.whole) for name in study.models)


def select(samples: Samples, count: int, seed: int) -> Samples:
    return samples[np.sort(np.random.default_rng(seed).permutation(len(samples))[:count])]


def train(problem: OptimalControlProblem, run: Run, folders: Folders) -> NetworkPlanner:
    samples = folders.samples(problem, WHOLE if run.settings == study_of(problem).whole else "training")
    if run.samples < len(samples):
        samples = select(samples, run.samples, run.seed)
    if run.hidden is None:
        return recipes.make(run.name, samples, settings=run.settings, seed=run.seed)  # type: ignore[return-value]
    return fit_single(samples, settings=run.settings, seed=run.seed, sizes=layer_sizes(problem, run.hidden))


def execute(env_id: str, run: Run, key: str, folders: Folders) -> dict[str, Any]:
    """Train unless the model is there, evaluate on the validation set and keep the record."""
    torch.set_num_threads(1)
    problem, path = ocp_envs.load(env_id), folders.model(key)
    if Path(f"{path}.json").exists():
        planner = load_file(path, problem)
    else:
        planner = train(problem, run, folders)
        planner.save(path)
    validation = folders.samples(problem, "validation")
    contestant = comparison.Contestant(run.name, planner)
    row, _ = comparison.run(problem, contestant, validation.parameters, optimal=validation.trajectory, batches=())
    parts = planner.details["training"]["parts"]
    record = {
        "seed": run.seed,
        "samples": run.samples,
        "success": row["success"]["count"],
        "success_at_plan_end": row["success_at_plan_end"]["count"],
        "reached": row["reached"]["count"],
        "violation": row["violation_mean"],
        "knot_violation": row["knot_violation_mean"],
        "test_error": row["test_error"],
        "validation_error": row["validation_error"],
        "training_seconds": planner.details["training"]["seconds"],
        "gate_accuracy": next((part["accuracy"] for part in parts if part["accuracy"] is not None), None),
        "part_test_errors": [part["test_loss"] for part in parts if part["accuracy"] is None],
        "cluster_sizes": planner.details.get("clusters", {}).get("sizes"),
        "peak_memory_gb": planner.details["training"].get("peak_memory_gb"),
    }
    write_json(folders.record(problem, key), record)
    return record


def run_all(
    problem: OptimalControlProblem, runs: dict[Run, str], folders: Folders, workers: int | None
) -> dict[Run, dict[str, Any]]:
    paths = {run: folders.record(problem, key) for run, key in runs.items()}
    records = {run: json.loads(path.read_text()) for run, path in paths.items() if path.exists()}
    with WorkerPool(workers) as pool:
        futures = {
            pool.submit(execute, problem.id, run, key, folders): run for run, key in runs.items() if run not in records
        }
        for future in tqdm(as_completed(futures), total=len(futures), unit="model", disable=None):
            records[futures[future]] = future.result()
    return records


def spread(values: list[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "least": min(values), "most": max(values)}


def row_of(name: str, records: list[dict[str, Any]]) -> dict[str, Any]:
    row: dict[str, Any] = {"name": name, "samples": records[0]["samples"]}
    for key in records[0].keys() - {"samples"}:
        row[f"{key}s" if key == "seed" else key] = [r.get(key) for r in records]
    measured = ("success", "success_at_plan_end", "violation", "knot_violation", "test_error", "validation_error")
    for key in (*measured, "training_seconds"):
        if row.get(key, [None])[0] is not None:
            row[f"{key}_spread"] = spread(row[key])
    return row


def assemble(
    problem: OptimalControlProblem, study: Study, records: dict[Run, dict[str, Any]], total: int
) -> dict[str, Any]:
    def collect(name: str, samples: int, settings: TrainingSettings | None, hidden: Any = None) -> dict[str, Any]:
        chosen = [r for r in records if (r.name, r.samples, r.settings, r.hidden) == (name, samples, settings, hidden)]
        return row_of(name, [records[r] for r in sorted(chosen, key=lambda r: r.seed)])

    whole = max((run.samples for run in records if run.settings == study.whole), default=None)
    rows = []
    for name in study.models:
        row = collect(name, total, study.settings) if whole is None else collect(name, whole, study.whole)
        if published := study.published.get(name):
            row |= {f"paper_{key}": value for key, value in dataclasses.asdict(published).items() if value is not None}
        rows.append(row)
    if whole is not None:
        rows += [
            collect(name, total, study.settings) | {"name": f"{name}, {total:,} problems"} for name in study.models
        ]
    for name in study.paper_settings:
        rows.append(collect(name, total, PAPER) | {"name": f"{name}, the paper's training settings"})
    ablation = [
        collect("snn", total, study.settings, None if hidden == PAPER_SIZES[problem.id].single else hidden)
        | {"hidden": list(hidden), "paper_test_error": error}
        for hidden, error in study.ablation.items()
    ]
    counts: list[tuple[int, TrainingSettings | None]] = list(sizes_of(study, total))
    if whole is not None:
        counts.append((whole, study.whole))
    sizes = [collect(name, *size) for name in study.sized for size in counts]
    return {"settings": dataclasses.asdict(study.settings), "rows": rows, "ablation": ablation, "sizes": sizes}


def draw(
    problem: OptimalControlProblem, folders: Folders, models: dict[str, Path], results: Path, record: dict[str, Any]
) -> dict[str, Any]:
    """The figures; ``models`` are the planners of the first seed."""
    stem = results / f"training_{problem.id}"
    training, validation = (folders.samples(problem, name) for name in ("training", "validation"))
    partitions = {"custom": cluster(training, "custom")}
    for name in models:
        if name.startswith("moe-kmeans-"):
            k = int(name.rsplit("-", 1)[1])
            partitions[f"k-means {k}"] = cluster(training, "kmeans", k=k)
    planners: dict[str, Any] = {name: load_file(path, problem) for name, path in models.items()}
    if len({row["samples"] for row in record["sizes"]}) > 1:
        figures.sizes_figure(Path(f"{stem}_sizes.png"), record["sizes"], len(validation))
    errors = {}
    for name, planner in planners.items():
        _, episodes = comparison.run(problem, comparison.Contestant(name, planner), validation.parameters, batches=())
        errors[name] = (problem.goal_error(planner(validation.parameters).states[:, -1]), episodes.final_error)
    clusters = {name: labels.sizes.tolist() for name, labels in partitions.items()}
    if problem.picture is not None and problem.picture.dimensions == 3:
        _draw_space(stem, training, validation, partitions, planners, errors)
        return {"clusters": clusters}
    drawing = _draw_plane if len(problem.parameters) == 2 else _draw_paths
    chosen = drawing(stem, training, validation, partitions, planners, errors)
    costs = np.sort(validation.mode_costs[chosen])
    return {
        "clusters": clusters,
        "jump": {
            "parameters": validation.parameters[chosen].tolist(),
            "relative_cost_of_the_second_mode": float(costs[1] / costs[0] - 1) if len(costs) > 1 else None,
        },
    }


def _draw_plane(
    stem: Path, training: Samples, validation: Samples, partitions: Any, planners: dict[str, Any], errors: Any
) -> int:
    """Figures of a problem with two parameters; returns the validation case at the jump."""
    figures.clusters_figure(f"{stem}_clusters.png", training, partitions)
    costs = np.sort(validation.mode_costs, axis=1)
    chosen = int((costs[:, 1] / costs[:, 0]).argmin())
    plans = {name: planners[name](validation.parameters[chosen]) for name in ("snn", "moe-custom")}
    figures.discontinuity_figure(
        f"{stem}_jump.png", training, partitions["custom"], validation.trajectory[chosen], plans
    )
    figures.error_figure(f"{stem}_errors.png", errors, training.problem.goal.radius)
    return chosen


def _draw_paths(
    stem: Path, training: Samples, validation: Samples, partitions: Any, planners: dict[str, Any], errors: Any
) -> int:
    """Figures of a problem whose trajectories are paths in the plane; returns the case where SNN interpolates."""
    problem = training.problem
    trajectory_figures.samples_figure(f"{stem}_samples.png", training, partitions["custom"])
    trajectory_figures.histories_figure(f"{stem}_histories.png", training, partitions["custom"])
    shown = {name: errors[name] for name in ("snn", "moe-custom")}
    trajectory_figures.error_histograms_figure(f"{stem}_errors.png", shown, problem.goal.radius)
    nearest = NearestPlanner(training)
    pair = planners["snn"], planners["moe-custom"]
    chosen = trajectory_figures.choose_interpolated(validation, *pair, training, NEIGHBOURS)
    p = validation.parameters[chosen]
    around = nearest.neighbours(p, NEIGHBOURS)[0]
    trajectory_figures.interpolation_figure(
        f"{stem}_interpolation.png",
        validation.trajectory[chosen],
        training[around],
        {planner.name: planner(p) for planner in pair},
        problem,
    )
    return chosen


def _draw_space(
    stem: Path, training: Samples, validation: Samples, partitions: Any, planners: dict[str, Any], errors: Any
) -> None:
    """Figures of a problem whose trajectories are paths in space."""
    problem = training.problem
    for name, labels in partitions.items():
        if labels.k > 1:
            file = f"{stem}_samples_{name.replace(' ', '-')}.png"
            space_figures.samples_figure(file, training, labels)
    trajectory_figures.error_histograms_figure(f"{stem}_errors.png", errors, problem.goal.radius)
    if problem.n_clearances:
        p = validation.parameters
        violations = {name: plan_violations(problem, p, planner(p)) for name, planner in planners.items()}
        space_figures.violations_figure(f"{stem}_violations.png", violations, "plans that enter the sphere")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--seeds", type=int, default=5, help="training seeds of every model")
    parser.add_argument("--models", nargs="+", help="train these alone, and leave the results as they are")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--ship", action="store_true", help="put the models of the first seed into the package")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    began = time.perf_counter()
    problem = ocp_envs.load(arguments.env)
    folders = Folders(arguments.data / problem.id, arguments.data / "compare_training" / problem.id)
    training, study = ocp_envs.Database.open(folders.data / "training.zarr", problem), study_of(problem)
    total, data = len(training.solved(training.first(study.problems))), training.key
    largest = list(plan_whole(study, training, total))
    chosen = [*largest, *plan(problem, study, arguments.seeds, total)]
    runs = {run: run.key(data) for run in chosen if arguments.models is None or run.name in arguments.models}
    records = run_all(problem, runs, folders, arguments.workers)
    if arguments.models is not None:
        return
    record = assemble(problem, study, records, total)
    first = {run.name: run for run in largest or (Run(name, 0, total, study.settings) for name in study.models)}
    models = {name: folders.model(runs[run]) for name, run in first.items() if "pca" not in name}
    if arguments.ship:
        for name in study.compared:
            load_file(models[name], problem).save(SHIPPED / problem.id / name)
    record |= draw(problem, folders, models, arguments.results, record)
    record |= {"env_id": problem.id, "training_key": data, "seconds": time.perf_counter() - began}
    write_json(arguments.results / f"compare_training_{problem.id}.json", record | {"provenance": provenance()})
    for row in record["rows"]:
        medians = [row[f"{key}_spread"]["median"] for key in ("success", "success_at_plan_end")]
        print(f"{row['name']:45s} {medians[0]:6.0f} {medians[1]:6.0f}")


if __name__ == "__main__":
    main()
