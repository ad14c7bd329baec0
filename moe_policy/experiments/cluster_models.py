"""Mixtures with several numbers k of k-means clusters, trained on a part of the training set with several seeds.

They are evaluated on the development set, on which k is chosen (:mod:`moe_policy.experiments.cluster_choice`). The
record of every model is kept in a folder, and within a training the state of each network: an interrupted run continues
where it stopped.
"""

from __future__ import annotations

import shutil
from concurrent.futures import as_completed
from dataclasses import dataclass
from typing import Self

import torch

import ocp_envs
from moe_policy.experiments import comparison
from moe_policy.experiments.benchmark.parts import Clusters
from moe_policy.experiments.seeds import Training
from moe_policy.experiments.trainings import Folders, Run, train
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.reports.records import ABSENT, Absent, Record, read, write
from moe_policy.rollouts.episodes import Episodes
from moe_policy.score.method import Method
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import track


@dataclass(frozen=True, kw_only=True)
class ClusterModel(Record):
    """One mixture on the development set."""

    k: int  # number of clusters
    seed: int  # of the training
    at_plan_end: int  # number of rollouts in the goal ball at the plan's end
    success: int  # number of successful rollouts
    clear_5_cm: int | Absent = ABSENT  # of them, those that violate path constraints by at most 5 cm on the whole path
    clear_1_cm: int | Absent = ABSENT  # the same with 1 cm
    relative_cost: float | None  # cost / cost of the tracked optimum
    gate_accuracy: float | Absent | None  # on the test split
    test_error: float  # smooth L1 loss on the test split
    training_seconds: float  # duration of the training
    parameters_total: int | None  # number of its weights
    parameters_active: int | None  # number of those that one plan uses

    @classmethod
    def of(cls, planner: NetworkPlanner, k: int, optimal: Episodes) -> Self:
        """``planner`` with ``k`` clusters on the instances of ``optimal``, the episodes that track their optima."""
        problem, method = planner.problem, Method(planner.name, planner)
        row, _ = comparison.run(problem, method, optimal.parameters, baseline=optimal, batches=())
        training, metrics = Training.of(planner), row.metrics
        assert metrics.success_at_plan_end is not None
        clear = {tolerance: found.count for tolerance, found in (metrics.success_clear or {}).items()}
        return cls(
            k=k,
            seed=training.seed,
            at_plan_end=metrics.success_at_plan_end.count,
            success=metrics.success.count,
            clear_5_cm=clear.get("0.05", ABSENT),
            clear_1_cm=clear.get("0.01", ABSENT),
            relative_cost=metrics.relative_cost,
            gate_accuracy=training.gate_accuracy,
            test_error=training.test_error,
            training_seconds=training.training_seconds,
            parameters_total=row.parameters_total,
            parameters_active=row.parameters_active,
        )


def tracked_optima(problem: OptimalControlProblem, samples: Samples) -> Episodes:
    """Episodes that track the optimal trajectories of ``samples``."""
    method = Method("optimal", StoredPlans(samples.parameters, samples.trajectory))
    return comparison.run(problem, method, samples.parameters, batches=())[1]


def execute(env_id: str, k: int, run: Run, key: str, folders: Folders, optimal: Episodes) -> None:
    """Train the mixture of ``run`` with ``k`` clusters, compare it with ``optimal`` and keep its record as ``key``."""
    torch.set_num_threads(1)
    problem, unfinished = ocp_envs.load(env_id), folders.work / "unfinished" / key
    model = ClusterModel.of(train(problem, run, folders, unfinished), k, optimal)
    shutil.rmtree(unfinished)
    write(folders.record(problem, key), model)


def execute_all(
    problem: OptimalControlProblem,
    clusters: Clusters,
    seeds: int,
    folders: Folders,
    development: Samples,
    workers: int | None = None,
) -> list[list[ClusterModel]]:
    """The models of every k, one for each seed; those that are kept are not trained again.

    Args:
        problem: the problem.
        clusters: the values of k, and how mixtures are trained.
        seeds: number of training seeds.
        folders: of the databases and of what is kept.
        development: the solved instances on which they are evaluated.
        workers: number of processes; ``None`` for one per core.
    """
    data = ocp_envs.Database.open(folders.data / "training.zarr", problem).key
    keys: dict[tuple[int, Run], str] = {}
    for seed in range(seeds):
        for k in clusters.numbers:
            run = Run(f"moe-kmeans-{k}", seed, clusters.instances, clusters.settings, first=clusters.instances)
            keys[k, run] = f"{run.key(data)}-{len(development)}"
    paths = {of: folders.record(problem, key) for of, key in keys.items()}
    missing = [of for of, path in paths.items() if not path.exists()]
    if missing:
        optimal = tracked_optima(problem, development)
        with WorkerPool(workers) as pool:
            tasks = [pool.submit(execute, problem.id, *of, keys[of], folders, optimal) for of in missing]
            for task in track(as_completed(tasks), len(tasks), unit="model", label=problem.id):
                task.result()
    return [[read(path, ClusterModel) for of, path in paths.items() if of[0] == k] for k in clusters.numbers]
