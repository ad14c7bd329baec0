"""The trainings of a benchmark: which networks are trained on how many instances with which seeds, and their models.

Every result is kept in a folder, and within a training the state of each network: an interrupted run continues where it
stopped. A result counts for its database and settings alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

import ocp_envs
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.benchmark.parts import Benchmark
from moe_policy.experiments.seeds import Model
from moe_policy.learning import recipes
from moe_policy.learning.architectures import PAPER_SIZES, layer_sizes
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_single
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import read, write
from moe_policy.store import load_file
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import track

#: The paper's training settings, with which some planners are trained as well.
PAPER = TrainingSettings.paper()
#: Name of the training set with all its instances.
WHOLE = "whole"


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]


@dataclass(frozen=True)
class Run:
    """One training."""

    name: str  # of the recipe
    seed: int  # of the training
    samples: int  # number of training instances
    settings: TrainingSettings  # of the training
    hidden: tuple[int, ...] | None = None  # hidden layers of a single network; ``None`` for those of the recipe
    first: int | None = (
        None  # number of instances of the database it is trained on; ``None`` for those of the benchmark
    )

    def key(self, data: str) -> str:
        """Name of its files; ``data`` is the key of the training database."""
        layers = "" if self.hidden is None else "-" + "-".join(map(str, self.hidden))
        record = json.dumps([data, dataclasses.asdict(self.settings)], sort_keys=True)
        return f"{self.name}{layers}-n{self.samples}-s{self.seed}-{_hash(record)}"


@dataclass(frozen=True)
class Folders:
    """Where the databases of a problem are, and where its models and their records are written."""

    data: Path  # folder of the databases
    work: Path  # folder of models, records and unfinished trainings

    def model(self, key: str) -> Path:
        """Path of the model of a run."""
        return self.work / "models" / key

    def record(self, problem: OptimalControlProblem, key: str) -> Path:
        """Path of the record of a model, which depends on how its plans are tracked."""
        weights = dataclasses.asdict(TrackingWeights.default(problem))
        tracking = json.dumps({k: np.array(v).tolist() for k, v in weights.items()}, sort_keys=True)
        return self.work / f"{key}-{_hash(tracking)}.json"

    @lru_cache(maxsize=4)  # noqa: B019 - one for each process
    def samples(self, problem: OptimalControlProblem, name: str, first: int | None = None) -> Samples:
        """A split; of the training set the ``first`` instances, by default those of the benchmark, or ``WHOLE``."""
        database = ocp_envs.Database.open(self.data / f"{'training' if name == WHOLE else name}.zarr", problem)
        few = database.first(first or benchmark_of(problem).training.instances) if name == "training" else None
        return database.samples(few)


def sizes_of(benchmark: Benchmark, total: int) -> list[tuple[int, TrainingSettings]]:
    """Numbers of training instances and the settings for them, increasing; ``total``, the whole set, is the last."""
    settings, epochs = benchmark.training.settings, benchmark.training.sizes
    smaller = [(size, dataclasses.replace(settings, epochs=n)) for size, n in epochs.items() if size < total]
    return [*smaller, (total, settings)]


def over_seeds(database: ocp_envs.Database, seeds: int, names: Sequence[str] | None = None) -> Iterator[Run]:
    """The runs of ``names``, by default the compared networks, with ``seeds`` seeds and equal settings, all on the same
    instances."""
    benchmark = benchmark_of(database.problem)
    training = benchmark.training
    first, epochs = training.over_seeds or (training.instances, training.settings.epochs)
    total = len(database.solved(database.first(first)))
    settings = dataclasses.replace(training.settings, epochs=epochs)
    for name in benchmark.planners.compared if names is None else names:
        yield from (Run(name, seed, total, settings, first=first) for seed in range(seeds))


def planned(problem: OptimalControlProblem, seeds: int, total: int) -> Iterator[Run]:
    """All runs on the ``total`` instances of the training set, those of the first seed first."""
    benchmark = benchmark_of(problem)
    training = benchmark.training
    for seed in range(seeds):
        for name in benchmark.planners.trained:
            yield Run(name, seed, total, training.settings)
        for name in training.paper:
            yield Run(name, seed, total, PAPER)
        if seed >= training.fewer_seeds:
            continue
        for hidden in training.depths:
            if hidden != PAPER_SIZES[problem.id].single:
                yield Run("snn", seed, total, training.settings, hidden)
        for size, settings in sizes_of(benchmark, total):
            yield from (Run(name, seed, size, settings) for name in training.sized if size < total)


def planned_on_all(database: ocp_envs.Database, total: int) -> Iterator[Run]:
    """The runs on all instances of a complete ``database``, where the other runs use fewer, ``total``."""
    whole = benchmark_of(database.problem).training.whole
    if whole and database.complete and (count := database.totals()["solved"]) > total:
        yield from (Run(name, 0, count, settings) for name, settings in whole.items())


def train(problem: OptimalControlProblem, run: Run, folders: Folders, checkpoints: Path) -> NetworkPlanner:
    """The network of ``run``; the unfinished training is kept in the folder ``checkpoints``."""
    on_all = run.settings == benchmark_of(problem).training.whole.get(run.name)
    samples = folders.samples(problem, WHOLE if on_all else "training", run.first)
    if run.samples < len(samples):
        samples = samples[np.sort(np.random.default_rng(run.seed).permutation(len(samples))[: run.samples])]
    if run.hidden is None:
        kept = folders.data / "training.continuation"
        made = recipes.make(run.name, samples, settings=run.settings, seed=run.seed, checkpoints=checkpoints, kept=kept)
        assert isinstance(made, NetworkPlanner)
        return made
    sizes = layer_sizes(problem, run.hidden)
    return fit_single(samples, settings=run.settings, seed=run.seed, sizes=sizes, checkpoints=checkpoints)


def trained(env_id: str, run: Run, key: str, folders: Folders) -> NetworkPlanner:
    """The network of ``run``, trained and kept under ``key`` unless it exists."""
    torch.set_num_threads(1)
    problem, path = ocp_envs.load(env_id), folders.model(key)
    if Path(f"{path}.json").exists():
        return load_file(path, problem, kind=NetworkPlanner)
    unfinished = folders.work / "unfinished" / key
    planner = train(problem, run, folders, unfinished)
    planner.save(path)
    shutil.rmtree(unfinished)
    return planner


def train_all(
    problem: OptimalControlProblem, runs: Mapping[Run, str], folders: Folders, workers: int | None = None
) -> None:
    """Train the networks of all ``runs`` (with the key of their files) that are not kept."""
    missing = {run: key for run, key in runs.items() if not Path(f"{folders.model(key)}.json").exists()}
    with WorkerPool(workers) as pool:
        futures = [pool.submit(trained, problem.id, run, key, folders) for run, key in missing.items()]
        for future in track(as_completed(futures), len(futures), unit="model", label=problem.id):
            future.result()


def execute(env_id: str, run: Run, key: str, folders: Folders) -> Model:
    """Train unless the model exists, evaluate it on the validation set and keep its record under ``key``."""
    problem, planner = ocp_envs.load(env_id), trained(env_id, run, key, folders)
    model = Model.of(planner, folders.samples(problem, "validation"))
    write(folders.record(problem, key), model)
    return model


def execute_all(
    problem: OptimalControlProblem,
    runs: Mapping[Run, str],
    folders: Folders,
    workers: int | None = None,
    names: Collection[str] | None = None,
) -> dict[Run, Model]:
    """The models of all ``runs`` (with the key of their files) that are kept, and of the others after training them.

    ``names``: recipes that are trained; all by default.
    """
    paths = {run: folders.record(problem, key) for run, key in runs.items()}
    models = {run: read(path, Model) for run, path in paths.items() if path.exists()}
    with WorkerPool(workers) as pool:
        futures = {
            pool.submit(execute, problem.id, run, key, folders): run
            for run, key in runs.items()
            if run not in models and (names is None or run.name in names)
        }
        for future in track(as_completed(futures), len(futures), unit="model", label=problem.id):
            models[futures[future]] = future.result()
    return models


def networks(
    problem: OptimalControlProblem, data: Path, seeds: int, names: Sequence[str] | None = None
) -> dict[Run, NetworkPlanner]:
    """The networks ``names``, by default those that the benchmark compares, that were trained with ``seeds`` seeds from
    the database in ``data``.

    Raises:
        FileNotFoundError: one was not trained; the message has the command that trains it.
    """
    folders = Folders(data / problem.id, data / "compare_training" / problem.id)
    training = ocp_envs.Database.open(folders.data / "training.zarr", problem)
    found = {run: folders.model(run.key(training.key)) for run in over_seeds(training, seeds, names)}
    for run, path in found.items():
        if not Path(f"{path}.json").exists():
            command = f"scripts/compare_training.py --env {problem.id} --seeds {seeds} --over-seeds"
            raise FileNotFoundError(
                f"{problem.id} has no {run.name} of seed {run.seed} in {path.parent}; run {command}"
            )
    return {run: load_file(path, problem, kind=NetworkPlanner) for run, path in found.items()}
