"""Compare optimal control, networks, mixtures of experts, reinforcement learning and the bare stabiliser.

All run on the same starts, through the same rollout loop. With no argument the shipped pendulum models run on the
shipped validation set, which takes about a minute; ``--env GroundVehicle-v0`` takes a few. ``--train`` first makes
everything anew under ``data/compare/``: training, development and validation sets, planners, and where the study has a
short budget for it, a reinforcement learner. The table goes to the terminal, and with all figures to
``results/compare_<env>.json`` and ``.png`` (with ``--train`` to ``results/compare_trained_<env>.*``).
"""

from __future__ import annotations

import argparse
import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import moe_policy
import ocp_envs
from moe_policy import baselines, recipes
from moe_policy.comparison import COLUMNS, Contestant, outcome, run
from moe_policy.evaluation import time_planner
from moe_policy.optimal import SolverPlanner
from moe_policy.planner import NearestPlanner
from moe_policy.reporting import comparison_figure, text_table
from moe_policy.studies import study_of
from ocp_envs import reference
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.records import provenance, write_json
from ocp_envs.splits import split_of, splits_of
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory
from ocp_envs.workers import WorkerPool

ROOT = Path(__file__).resolve().parents[1]
#: Starts of one share of the optimal planner's work.
SHARE = 250


def log(text: str) -> None:
    print(text, flush=True)


def solutions(count: int) -> str:
    return f"{count:,} solutions"


def steps(count: int) -> str:
    return f"{count:,} steps"


def shipped(problem: OptimalControlProblem) -> tuple[NearestPlanner, list[Contestant]]:
    """The models of the package."""
    study = study_of(problem)
    nearest = moe_policy.load(problem.id, "nearest")
    contestants = [Contestant("nearest", nearest, solutions(len(nearest.parameters)))]
    for name in study.compared:
        planner = moe_policy.load(problem.id, name)
        record = planner.details
        contestants.append(Contestant(name, planner, solutions(record["samples"]), record["training"]["seconds"]))
    for name in study.learners:
        if name not in moe_policy.available(problem.id):
            log(f"{name} is not shipped for {problem.id}; scripts/train_rl.py trains it")
            continue
        policy = moe_policy.load(problem.id, name)
        training = json.loads((ROOT / "results" / f"training_{name}_{problem.id}.json").read_text())
        contestants.append(Contestant(name, policy, steps(training["steps"]), training["seconds"]))
    return nearest, contestants


def trained(problem: OptimalControlProblem, folder: Path, seed: int) -> tuple[NearestPlanner, list[Contestant], Any]:
    """Everything made anew: data, planners and, where the study has a short budget, a reinforcement learner."""
    study, databases = study_of(problem), {}
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
    samples = databases["training"].samples(databases["training"].first(study.problems))
    nearest = NearestPlanner(samples)
    contestants = [Contestant("nearest", nearest, solutions(len(samples)))]
    for name in study.compared:
        with WorkerPool() as pool:
            planner: Any = recipes.make(name, samples, settings=study.settings, seed=seed, executor=pool)
        planner.save(folder / name)
        seconds = planner.details["training"]["seconds"]
        log(f"{name}: trained in {seconds:.0f} s")
        contestants.append(Contestant(name, planner, solutions(len(samples)), seconds))
    for name, settings in study.short_learners.items():
        result = baselines.train(problem, settings, databases["development"].parameters)
        result.policy.save(folder / name)
        log(f"{name}: {settings.steps:,} steps in {result.curve[-1].seconds:.0f} s")
        contestants.append(Contestant(name, result.policy, steps(settings.steps), result.curve[-1].seconds))
    return nearest, contestants, databases["validation"]


def solve_all(problem: OptimalControlProblem, nearest: NearestPlanner, p: Array) -> tuple[Trajectory, Array]:
    """Optimal trajectories and their costs, with a solver process for every core."""
    local = threading.local()

    def solve(begin: int) -> tuple[Trajectory, Array]:
        if not hasattr(local, "planner"):
            local.planner = SolverPlanner(problem, nearest, lookaround=study_of(problem).lookaround)
        return local.planner.best(p[begin : begin + SHARE])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        shares = range(0, len(p), SHARE)
        parts = list(tqdm(pool.map(solve, shares), total=len(shares), desc="optimal", disable=None, leave=False))
    return Trajectory.concatenate([plan for plan, _ in parts]), np.concatenate([cost for _, cost in parts])


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
        nearest, contestants, validation = trained(problem, ROOT / "data" / "compare" / problem.id, arguments.seed)
        parameters, costs = validation.parameters, validation.costs().min(axis=1)
    else:
        nearest, contestants = shipped(problem)
        validation = reference.load(problem, "validation")
        parameters, costs = validation.parameters, validation.cost
    parameters, costs = parameters[: arguments.cases], costs[: arguments.cases]
    log(f"{len(parameters)} starts of {problem.id}")

    trajectories, found = solve_all(problem, nearest, parameters)
    optimal = SolverPlanner(problem, nearest, lookaround=study_of(problem).lookaround)
    timed = time_planner(optimal, parameters, (1,), repeats=20) | time_planner(optimal, parameters, (1000,), repeats=1)
    planning = {str(batch): seconds for batch, seconds in timed.items()}
    gap = np.abs(found / costs - 1)
    same = int((gap < 1e-3).sum())
    log(f"optimal trajectories: {np.isfinite(found).sum()} solved; {same} at the reference cost within 0.1 %")
    # What was solved is followed, not solved again.
    row, baseline = run(problem, Contestant("optimal", lambda p: trajectories), parameters, batches=())
    row["planning_seconds"] = planning
    rows, outcomes = [row], [outcome("optimal", baseline, problem)]
    if problem.hold:
        contestants.append(Contestant("stabiliser", moe_policy.Stabiliser(problem)))
    for contestant in contestants:
        row, episodes = run(problem, contestant, parameters, optimal=trajectories, baseline=baseline)
        rows.append(row)
        outcomes.append(outcome(contestant.name, episodes, problem))
        log(f"{contestant.name}: {row['success']['count']} of {len(parameters)}")

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
