"""Success on a plant that differs from the model: mismatch, disturbances, measurement noise, control delay.

The tracked optimum, the nearest neighbour, networks, reinforcement learners and the stabiliser run from the first
validation parameters, on plants that differ in one respect at a time, through the common rollout loop; all plan with
the nominal model, but for the first mixture with known constants, whose plans are solved for the constants of the plant
where these differ. Optimal trajectories are solved once and stored in ``data/optimal/<env>``, the outcome of each level
in ``data/robustness/<env>``, so that an interrupted command continues. What is stored is used again for the same
problem, models, parameters, seed, plant and package versions alone; delete it after a change of the program. Writes
``robustness_<env>.json`` and ``.png``.

With ``--estimated`` the tracked optimum and the first mixture act on an estimate of the state instead: the delay of the
plant and its noise are known and compensated for, an offset at the control is estimated and removed. The record is
``robustness_estimated_<env>.json``; its figure also shows the two without an estimate, if the other record is there.

    python scripts/compare_robustness.py --env GroundVehicle-v0
    python scripts/compare_robustness.py --cases 50
    python scripts/compare_robustness.py --estimated --cases 200
"""

import hashlib
import json
import time
from collections.abc import Mapping
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, replace
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
from moe_policy.experiments.robustness import (
    Plant,
    Robustness,
    at_all_levels,
    estimated,
    informed,
    plant_key,
    run_plant,
)
from moe_policy.planners.network import NetworkPlanner
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


def networks(problem: OptimalControlProblem) -> list[Method]:
    """The networks among the methods, mixtures of experts first."""
    found = [method for method in methods(problem) if isinstance(method.actor, NetworkPlanner)]
    return sorted(found, key=lambda method: not method.name.startswith("moe"))


def of_names(record: Robustness, problem: OptimalControlProblem) -> Robustness:
    """The rows of ``record`` that belong to the optimum and the first mixture of ``problem``."""
    names = ("optimal", networks(problem)[0].name)
    return replace(record, rows=tuple(row for row in record.rows if row.outcome.name in names))


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
    estimated: bool  # whether methods act on an estimate


def work(task: Task, arguments: EnvArguments, path: Path) -> None:
    """Run all methods on one plant and store the outcome in the file ``path``."""
    cli.threads()
    began = time.process_time()
    problem = ocp_envs.load(task.env_id)
    optimal = Method("optimal", StoredPlans(task.parameters, problem.unflatten(task.flat)))
    compared = [optimal, *methods(problem)]
    if "constants" in arguments or not arguments:
        compared += [informed(network, arguments) for network in networks(problem)[:1]]
    if task.estimated:
        compared = estimated(problem, [optimal, networks(problem)[0]], arguments, DT)
    rows = run_plant(problem, compared, task.parameters, arguments, seed=task.seed, dt=DT)
    write(path, Plant(arguments=arguments, rows=rows, cpu_seconds=time.process_time() - began))


def work_all(task: Task, plants: Mapping[Path, EnvArguments], workers: int | None) -> None:
    """Call :func:`work` for each of ``plants`` whose file does not exist, in ``workers`` processes."""
    with WorkerPool(workers) as pool:
        futures = [pool.submit(work, task, plant, path) for path, plant in plants.items() if not path.exists()]
        for future in track(as_completed(futures), len(futures), unit="level", label=task.env_id):
            future.result()


def compare(
    problem: OptimalControlProblem,
    parameters: Array,
    *,
    data: Path,
    seed: int,
    workers: int | None,
    on_estimates: bool = False,
) -> Robustness:
    """The record of all methods on all plants, from ``parameters`` (B, np); ``data``: where outcomes are stored.

    With ``on_estimates`` it is that of the optimum and the first mixture, which act on an estimate of the state.
    """
    perturbations = benchmark_of(problem).perturbations
    flat = solve_all(problem, parameters, keep=data / "optimal" / problem.id, workers=workers)[0].flat()
    same, folder = identity(problem, parameters, flat, seed), data / "robustness" / problem.id
    same += ", estimated" if on_estimates else ", constants known"
    plants = {(p.name, level): p.arguments(problem, level, DT) for p in perturbations for level in p.levels}
    paths = {key: folder / f"{plant_key(same, plant)}.json" for key, plant in plants.items()}
    # The nominal plants of all perturbations are one.
    task = Task(problem.id, parameters, flat, seed, on_estimates)
    work_all(task, {path: plants[key] for key, path in paths.items()}, workers)
    found = {path: read(path, Plant) for path in paths.values()}
    rows = [row for p in perturbations for row in at_all_levels(p, [found[paths[p.name, lv]].rows for lv in p.levels])]
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
    parser.add_argument("--estimated", action="store_true", help="methods act on an estimate of the state")
    arguments = parser.parse()
    problem, data = arguments.problem, arguments.data
    validation = reference.load(problem, "validation").parameters
    cli.at_most(arguments.cases, len(validation), "validation parameters")
    parameters = validation[: arguments.cases or max(MINIMUM, len(validation) // 5)]
    own, usual = arguments.estimated, f"robustness_{problem.id}"
    record = compare(problem, parameters, data=data, seed=arguments.seed, workers=arguments.workers, on_estimates=own)
    path = cli.publish(arguments, f"robustness_estimated_{problem.id}" if own else usual, record)
    without = arguments.results / f"{usual}.json"
    shown = record.beside(of_names(read(without, Robustness), problem)) if own and without.exists() else record
    robustness_figure(path.with_suffix(".png"), shown)
    cli.say(f"{record.tables()}\n{record.cpu_seconds:.0f} s of one core")


if __name__ == "__main__":
    cli.run(main, continues=True)
