"""Success on a plant that differs from the model: mismatch, disturbances, measurement noise, control delay.

The tracked optimum, the nearest neighbour, networks, reinforcement learners and the stabiliser run from the first
validation parameters, on plants that differ in one respect at a time, through the common rollout loop; all plan with
the nominal model. Optimal trajectories are solved once and stored in ``data/optimal/<env>``, the outcome of each level
in ``data/robustness/<env>``, so that an interrupted command continues. What is stored is used again for the same
problem, models, parameters, seed, plant and package versions alone; delete it after a change of the program. Writes
``robustness_<env>.json`` and ``.png``.

    python scripts/compare_robustness.py --env GroundVehicle-v0
    python scripts/compare_robustness.py --cases 50
"""

import hashlib
import json
import time
from collections.abc import Mapping
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

import ocp_envs
from moe_policy import store
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.figures.generalisation import robustness_figure
from moe_policy.experiments.methods import shipped, solve_all, stabiliser
from moe_policy.experiments.robustness import LevelRow, Plant, Robustness, plant_key, run_plant
from moe_policy.planners.stored import StoredPlans
from moe_policy.reports.records import read, write
from moe_policy.score.method import Method
from ocp_envs.envs.options import EnvArguments
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.arrays import Array
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance

#: Control period, seconds.
DT = 0.02
#: Without ``--cases``, a fifth of the validation set runs, but at least so many.
MINIMUM = 1000


@lru_cache(maxsize=1)
def methods(problem: OptimalControlProblem) -> list[Method]:
    """All methods but the optimum."""
    return [*shipped(problem), *stabiliser(problem)]


def identity(problem: OptimalControlProblem, parameters: Array, optimal: Array, seed: int) -> str:
    """A hash of everything that the outcome of a level depends on but the level; ``optimal`` are flat trajectories."""
    sha = hashlib.sha256()
    weights = {key: str(value) for key, value in asdict(TrackingWeights.default(problem)).items()}
    sha.update(json.dumps([problem.fingerprint, seed, DT, weights, provenance().versions]).encode())
    for method in methods(problem):
        sha.update(method.name.encode())
        description = store.SHIPPED / problem.id / f"{method.name}.json"  # contains the hash of the tensors
        sha.update(description.read_bytes() if description.exists() else b"")
    for array in (parameters, optimal):
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


@dataclass(frozen=True, eq=False)
class Task:
    """What is the same on all plants."""

    env_id: str
    parameters: Array  # p of the episodes, (B, np)
    flat: Array  # their optimal trajectories
    seed: int  # of noise and disturbances


def work(task: Task, arguments: EnvArguments, path: Path) -> None:
    """Run all methods on one plant and store the outcome in the file ``path``."""
    cli.threads()
    began = time.process_time()
    problem = ocp_envs.load(task.env_id)
    optimal = Method("optimal", StoredPlans(task.parameters, problem.unflatten(task.flat)))
    rows = run_plant(problem, [optimal, *methods(problem)], task.parameters, arguments, seed=task.seed, dt=DT)
    write(path, Plant(arguments=arguments, rows=rows, cpu_seconds=time.process_time() - began))


def work_all(task: Task, plants: Mapping[Path, EnvArguments], workers: int | None) -> None:
    """Call :func:`work` for each of ``plants`` whose file does not exist, in ``workers`` processes."""
    with WorkerPool(workers) as pool:
        futures = [pool.submit(work, task, plant, path) for path, plant in plants.items() if not path.exists()]
        for future in track(as_completed(futures), len(futures), unit="level", label=task.env_id):
            future.result()


def compare(
    problem: OptimalControlProblem, parameters: Array, *, data: Path, seed: int, workers: int | None
) -> Robustness:
    """The record of all methods on all plants, from ``parameters`` (B, np); ``data``: where outcomes are stored."""
    perturbations = benchmark_of(problem).perturbations
    flat = solve_all(problem, parameters, keep=data / "optimal" / problem.id, workers=workers)[0].flat()
    same, folder = identity(problem, parameters, flat, seed), data / "robustness" / problem.id
    plants = {(p.name, level): p.arguments(problem, level, DT) for p in perturbations for level in p.levels}
    paths = {key: folder / f"{plant_key(same, plant)}.json" for key, plant in plants.items()}
    # The nominal plants of all perturbations are one.
    task = Task(problem.id, parameters, flat, seed)
    work_all(task, {path: plants[key] for key, path in paths.items()}, workers)
    found = {path: read(path, Plant) for path in paths.values()}
    rows = [
        LevelRow(perturbation=name, level=level, outcome=row)
        for (name, level), path in paths.items()
        for row in found[path].rows
    ]
    return Robustness(
        env_id=problem.id,
        cases=len(parameters),
        seed=seed,
        dt=DT,
        perturbations=perturbations,
        rows=tuple(rows),
        cpu_seconds=sum(plant.cpu_seconds for plant in found.values()),
        provenance=provenance(),
    )


def main() -> None:
    parser = cli.parser(__doc__, data=True, workers=True, seed=0, cases="validation parameters")
    arguments = parser.parse()
    problem, data = arguments.problem, arguments.data
    validation = reference.load(problem, "validation").parameters
    cli.at_most(arguments.cases, len(validation), "validation parameters")
    parameters = validation[: arguments.cases or max(MINIMUM, len(validation) // 5)]
    record = compare(problem, parameters, data=data, seed=arguments.seed, workers=arguments.workers)
    robustness_figure(cli.publish(arguments, f"robustness_{problem.id}", record).with_suffix(".png"), record)
    cli.say(f"{record.tables()}\n{record.cpu_seconds:.0f} s of one core")


if __name__ == "__main__":
    cli.run(main, continues=True)
