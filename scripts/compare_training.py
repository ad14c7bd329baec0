"""The planners of a benchmark over several training seeds, ablations, and success against training size.

Every trained model is evaluated on the validation set. Runs are spread over the cores, each result is kept under
``data/compare_training/``, and within a run the state of every network once a minute: an interrupted command goes on
where it stopped. A result counts for its database and settings alone. Needs the databases of
``scripts/generate_data.py``. Writes ``results/compare_training_<env>.json`` and figures beside it. What is trained
stands in ``moe_policy/experiments/benchmark``.

    python scripts/compare_training.py --env GroundVehicle-v0 --seeds 3
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import shutil
import time
from collections.abc import Collection, Iterator
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import ocp_envs
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.benchmark.parts import Benchmark
from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.figures import gallery
from moe_policy.experiments.figures import phase as figures
from moe_policy.experiments.summary import beside_published, model_record, row_of
from moe_policy.learning import recipes
from moe_policy.learning.architectures import PAPER_SIZES, layer_sizes
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_single
from moe_policy.planners.network import NetworkPlanner
from moe_policy.store import SHIPPED, load_file
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
#: The paper's training settings, with which some planners are trained as well.
PAPER = TrainingSettings.paper()
#: All problems of the training set.
WHOLE = "whole"


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
        """A split; of the training set the instances that the benchmark trains on, or with ``WHOLE`` all."""
        database = ocp_envs.Database.open(self.data / f"{'training' if name == WHOLE else name}.zarr", problem)
        return database.samples(
            database.first(benchmark_of(problem).training.instances) if name == "training" else None
        )


def sizes_of(benchmark: Benchmark, total: int) -> list[tuple[int, TrainingSettings]]:
    """Numbers of training problems and the settings for them, the whole set last."""
    smaller = [
        (n, dataclasses.replace(benchmark.training.settings, epochs=e))
        for n, e in benchmark.training.sizes.items()
        if n < total
    ]
    return [*smaller, (total, benchmark.training.settings)]


def plan(problem: OptimalControlProblem, benchmark: Benchmark, seeds: int, total: int) -> Iterator[Run]:
    """All runs, those of the first seed first."""
    for seed in range(seeds):
        for name in benchmark.planners.trained:
            yield Run(name, seed, total, benchmark.training.settings)
        for name in benchmark.training.paper:
            yield Run(name, seed, total, PAPER)
        if seed >= benchmark.training.fewer_seeds:
            continue
        for hidden in benchmark.training.depths:
            if hidden != PAPER_SIZES[problem.id].single:
                yield Run("snn", seed, total, benchmark.training.settings, hidden)
        for size, settings in sizes_of(benchmark, total):
            yield from (Run(name, seed, size, settings) for name in benchmark.training.sized if size < total)


def plan_whole(benchmark: Benchmark, database: ocp_envs.Database, total: int) -> Iterator[Run]:
    """The runs on all problems, where the others are on fewer and the database is complete."""
    if benchmark.training.whole and database.complete and (count := database.totals()["solved"]) > total:
        yield from (Run(name, 0, count, settings) for name, settings in benchmark.training.whole.items())


def select(samples: Samples, count: int, seed: int) -> Samples:
    return samples[np.sort(np.random.default_rng(seed).permutation(len(samples))[:count])]


def train(problem: OptimalControlProblem, run: Run, folders: Folders, checkpoints: Path) -> NetworkPlanner:
    samples = folders.samples(
        problem, WHOLE if run.settings == benchmark_of(problem).training.whole.get(run.name) else "training"
    )
    if run.samples < len(samples):
        samples = select(samples, run.samples, run.seed)
    if run.hidden is None:
        made = recipes.make(run.name, samples, settings=run.settings, seed=run.seed, checkpoints=checkpoints)
        assert isinstance(made, NetworkPlanner)
        return made
    sizes = layer_sizes(problem, run.hidden)
    return fit_single(samples, settings=run.settings, seed=run.seed, sizes=sizes, checkpoints=checkpoints)


def execute(env_id: str, run: Run, key: str, folders: Folders) -> dict[str, Any]:
    """Train unless the model is there, evaluate on the validation set and keep the record."""
    torch.set_num_threads(1)
    problem, path = ocp_envs.load(env_id), folders.model(key)
    if Path(f"{path}.json").exists():
        planner = load_file(path, problem, kind=NetworkPlanner)
    else:
        unfinished = folders.work / "unfinished" / key
        planner = train(problem, run, folders, unfinished)
        planner.save(path)
        shutil.rmtree(unfinished)
    record = model_record(planner, folders.samples(problem, "validation"))
    write_json(folders.record(problem, key), record)
    return record


def run_all(
    problem: OptimalControlProblem,
    runs: dict[Run, str],
    folders: Folders,
    workers: int | None,
    models: Collection[str] | None = None,
) -> dict[Run, dict[str, Any]]:
    """The records of all runs that are kept, and of the others after training them; of ``models`` alone if given."""
    paths = {run: folders.record(problem, key) for run, key in runs.items()}
    records = {run: json.loads(path.read_text()) for run, path in paths.items() if path.exists()}
    with WorkerPool(workers) as pool:
        futures = {
            pool.submit(execute, problem.id, run, key, folders): run
            for run, key in runs.items()
            if run not in records and (models is None or run.name in models)
        }
        for future in tqdm(as_completed(futures), total=len(futures), unit="model", disable=None):
            records[futures[future]] = future.result()
    return records


def assemble(
    problem: OptimalControlProblem, benchmark: Benchmark, records: dict[Run, dict[str, Any]], total: int
) -> dict[str, Any]:
    def collect(
        name: str,
        samples: int,
        settings: TrainingSettings | None,
        hidden: Any = None,
        title: str | None = None,
        published: Published | None = None,
    ) -> list[dict[str, Any]]:
        """The row of one kind of run over its seeds; none where nothing is kept of it."""
        chosen = [r for r in records if (r.name, r.samples, r.settings, r.hidden) == (name, samples, settings, hidden)]
        ordered = [records[r] for r in sorted(chosen, key=lambda r: r.seed)]
        return [row_of(title or name, ordered, published)] if ordered else []

    whole = max((run.samples for run in records if run.samples > total), default=None)
    rows, fewer = [], []
    for name in benchmark.planners.trained:
        published, usual = benchmark.published.get(name), collect(name, total, benchmark.training.settings)
        largest = [] if whole is None else collect(name, whole, benchmark.training.whole.get(name), published=published)
        rows += largest or [row if published is None else beside_published(row, published) for row in usual]
        fewer += [row | {"name": f"{name}, {total:,} problems"} for row in usual if largest]
    rows += fewer
    for name in benchmark.training.paper:
        rows += collect(name, total, PAPER, title=f"{name}, the paper's training settings")
    ablation = [
        row | {"hidden": list(hidden), "paper_test_error": error}
        for hidden, error in benchmark.training.depths.items()
        for row in collect(
            "snn", total, benchmark.training.settings, None if hidden == PAPER_SIZES[problem.id].single else hidden
        )
    ]
    counts = sizes_of(benchmark, total)
    sizes = []
    for name in benchmark.training.sized:
        sizes += [row for size in counts for row in collect(name, *size)]
        sizes += [] if whole is None else collect(name, whole, benchmark.training.whole.get(name))
    settings: dict[str, Any] = {"settings": dataclasses.asdict(benchmark.training.settings)}
    if benchmark.training.whole:
        settings["settings_on_all_problems"] = {
            name: dataclasses.asdict(s) for name, s in benchmark.training.whole.items()
        }
    return settings | {"rows": rows, "ablation": ablation, "sizes": sizes}


def draw(
    problem: OptimalControlProblem, folders: Folders, models: dict[str, Path], results: Path, record: dict[str, Any]
) -> dict[str, Any]:
    """The figures, and what there is to tell about them; ``models`` are the planners of the first seed."""
    stem = results / f"training_{problem.id}"
    training, validation = (folders.samples(problem, name) for name in ("training", "validation"))
    planners = {name: load_file(path, problem, kind=NetworkPlanner) for name, path in models.items()}
    partitions = tuple(int(name.rsplit("-", 1)[1]) for name in models if name.startswith("moe-kmeans-"))
    material = gallery.Material(training, validation, planners, partitions)
    if len({row["samples"] for row in record["sizes"]}) > 1:
        figures.sizes_figure(Path(f"{stem}_sizes.png"), record["sizes"], len(validation))
    told = {
        name: drawing.draw(material, Path(f"{stem}_{name}.png")) for name, drawing in gallery.drawings(problem).items()
    }
    return {"figures": {name: details for name, details in told.items() if details}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--seeds", type=int, default=5, help="training seeds of every model")
    parser.add_argument("--models", nargs="+", help="train these alone; with --ship the results are of what is there")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--ship", action="store_true", help="put the models of the first seed into the package")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    began = time.perf_counter()
    problem = ocp_envs.load(arguments.env)
    folders = Folders(arguments.data / problem.id, arguments.data / "compare_training" / problem.id)
    training, benchmark = ocp_envs.Database.open(folders.data / "training.zarr", problem), benchmark_of(problem)
    total, data = len(training.solved(training.first(benchmark.training.instances))), training.key
    largest = list(plan_whole(benchmark, training, total))
    chosen = [*largest, *plan(problem, benchmark, arguments.seeds, total)]
    runs = {run: run.key(data) for run in chosen}
    records = run_all(problem, runs, folders, arguments.workers, arguments.models)
    if arguments.models is not None and not arguments.ship:
        return
    record = assemble(problem, benchmark, records, total)
    first = {name: Run(name, 0, total, benchmark.training.settings) for name in benchmark.planners.trained}
    first |= {run.name: run for run in largest if run in records}
    models = {name: folders.model(runs[run]) for name, run in first.items() if "pca" not in name}
    if arguments.ship:
        for name in benchmark.shipped:
            load_file(models[name], problem, kind=NetworkPlanner).save(SHIPPED / problem.id / name)
    record |= draw(problem, folders, models, arguments.results, record)
    record |= {"env_id": problem.id, "training_key": data, "seconds": time.perf_counter() - began}
    write_json(arguments.results / f"compare_training_{problem.id}.json", record | {"provenance": provenance()})
    for row in record["rows"]:
        medians = [row[f"{key}_spread"]["median"] for key in ("success", "success_at_plan_end")]
        print(f"{row['name']:45s} {medians[0]:6.0f} {medians[1]:6.0f}")


if __name__ == "__main__":
    main()
