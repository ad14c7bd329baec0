"""Compare optimal control, networks, mixtures of experts, reinforcement learning and the bare stabiliser.

All run on the same starts, through the same rollout loop. With no argument the shipped pendulum models run on the
shipped validation set, which takes about a minute; ``--env GroundVehicle-v0`` takes a few. ``--train`` first makes
everything anew under ``data/compare/``: training, development and validation sets, planners, and where the benchmark
has a short budget for it, a reinforcement learner. The table goes to the terminal, and with all figures to
``results/compare_<env>.json`` and ``.png`` (with ``--train`` to ``results/compare_trained_<env>.*``).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

import moe_policy
import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, outcome, run
from moe_policy.experiments.figures.comparison import comparison_figure
from moe_policy.experiments.latency import time_planner
from moe_policy.experiments.methods import (
    Method,
    optimal_planner,
    shipped,
    solutions,
    solve_all,
    stabiliser,
    steps,
    variants,
)
from moe_policy.experiments.tables import text_table
from moe_policy.learning import recipes
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.rl import training as baselines
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.splits import split_of, splits_of
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]


def log(text: str) -> None:
    print(text, flush=True)


def trained(problem: OptimalControlProblem, folder: Path, seed: int) -> tuple[NearestPlanner, list[Method], Any]:
    """Everything made anew: data, planners and, where the benchmark has a short budget, a reinforcement learner."""
    benchmark, databases = benchmark_of(problem), {}
    for name in splits_of(problem):
        split, began = split_of(problem, name), time.perf_counter()
        databases[name] = ocp_envs.generate(
            problem,
            folder / f"{name}.zarr",
            split.parameters(problem),
            seed=split.seed,
            settings=split.settings,
        )
        log(f"{name} set: {len(databases[name])} problems, {time.perf_counter() - began:.0f} s")
    samples = databases["training"].samples(databases["training"].first(benchmark.training.instances))
    nearest = NearestPlanner(samples)
    methods = [Method("nearest", nearest, solutions(len(samples)))]
    for name in benchmark.planners.compared:
        with WorkerPool() as pool:
            planner: Any = recipes.make(name, samples, settings=benchmark.training.settings, seed=seed, executor=pool)
        planner.save(folder / name)
        seconds = planner.details["training"]["seconds"]
        log(f"{name}: trained in {seconds:.0f} s")
        methods.append(Method(name, planner, solutions(len(samples)), seconds))
    for name, settings in benchmark.learners.short.items():
        result = baselines.train(problem, settings, databases["development"].parameters)
        result.policy.save(folder / name)
        log(f"{name}: {settings.steps:,} steps in {result.curve[-1].seconds:.0f} s")
        methods.append(Method(name, result.policy, steps(settings.steps), result.curve[-1].seconds))
    return nearest, methods, databases["validation"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--train", action="store_true", help="make data and models anew")
    parser.add_argument("--cases", type=int, help="validation cases; all by default")
    parser.add_argument("--seed", type=int, default=0, help="seed of the training")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    torch.set_num_threads(1)  # the networks are far too small for more
    began = time.perf_counter()
    problem = ocp_envs.load(arguments.env)
    if arguments.train:
        nearest, methods, validation = trained(problem, ROOT / "data" / "compare" / problem.id, arguments.seed)
        parameters, costs = validation.parameters, validation.costs().min(axis=1)
    else:
        methods = shipped(problem, ROOT / "results")
        for name in benchmark_of(problem).learners.settings:
            if name not in moe_policy.available(problem.id):
                log(f"{name} is not shipped for {problem.id}; scripts/train_rl.py trains it")
        nearest = moe_policy.load(problem.id, "nearest")
        validation = reference.load(problem, "validation")
        parameters, costs = validation.parameters, validation.cost
    parameters, costs = parameters[: arguments.cases], costs[: arguments.cases]
    log(f"{len(parameters)} starts of {problem.id}")

    trajectories, found = solve_all(problem, parameters, nearest, ROOT / "data" / "optimal" / problem.id)
    optimal = optimal_planner(problem, nearest)
    timed = time_planner(optimal, parameters, (1,), repeats=20)
    if len(parameters) >= 1000:  # fewer starts would be solved over and over
        timed |= time_planner(optimal, parameters, (1000,), repeats=1)
    planning = {str(batch): seconds for batch, seconds in timed.items()}
    gap = np.abs(found / costs - 1)
    same = int((gap < 1e-3).sum())
    log(f"optimal trajectories: {np.isfinite(found).sum()} solved; {same} at the reference cost within 0.1 %")
    # What was solved is followed, not solved again.
    row, baseline = run(problem, Method("optimal", StoredPlans(parameters, trajectories)), parameters, batches=())
    row["planning_seconds"] = planning
    rows, outcomes = [row], [outcome("optimal", baseline, problem)]
    for method in [*methods, *variants(problem, methods), *stabiliser(problem)]:
        row, episodes = run(problem, method, parameters, optimal=trajectories, baseline=baseline)
        rows.append(row)
        outcomes.append(outcome(method.name, episodes, problem))
        log(f"{method.name}: {row['success']['count']} of {len(parameters)}")

    name = f"compare_trained_{problem.id}" if arguments.train else f"compare_{problem.id}"
    record = {
        "env_id": problem.id,
        "cases": len(parameters),
        "seed": arguments.seed,
        "reference_gap": {"within_0.1_percent": same, "largest": float(gap[np.isfinite(gap)].max(initial=0.0))},
        "seconds": time.perf_counter() - began,
        "rows": rows,
        "provenance": provenance(),
    }
    write_json(arguments.results / f"{name}.json", record)
    comparison_figure(arguments.results / f"{name}.png", outcomes, problem.goal.radius)
    log(f"\n{text_table(rows, COLUMNS)}")
    log(f"{record['seconds']:.0f} s; written to {arguments.results / name}.json and .png")


if __name__ == "__main__":
    main()
