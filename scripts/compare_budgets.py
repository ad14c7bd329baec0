"""What reinforcement learning and planners get for what they spend: against environment steps, and against wall time.

Learners: the training curves of scripts/train_rl.py in ``results/training_<algorithm>_<env>[_seedN].json``, all seeds
that are there. Planners: the successes of ``results/compare_training_<env>.json`` over the solves and times of
``results/generation_<env>.json``. The curves are from the development parameters, so what is shipped of either kind,
and the optimal trajectories, are rolled out from these too, which takes a minute or two. What each side is given, and
how its budget is counted, stands in the record: ``results/budgets_<env>.json``, drawn in ``.png``.

    python scripts/compare_budgets.py --env GroundVehicle-v0
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

import ocp_envs
from moe_policy import store
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.budgets import (
    BUDGET_COLUMNS,
    GIVEN,
    PlannerBudget,
    budget_rows,
    generation_record,
    planner_rows,
)
from moe_policy.experiments.curves import learner_record, learner_runs
from moe_policy.experiments.figures.budgets import budgets_figure
from moe_policy.experiments.methods import Method, solve_all
from moe_policy.experiments.tables import text_table
from moe_policy.planners.network import NetworkPlanner
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.evaluation import Performance
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
DT = 0.02


def on_development(problem: OptimalControlProblem, method: Method, cases: reference.Reference) -> dict[str, Any]:
    """What an evaluation of a learner says, of anybody: planners are judged as such, and charged as learners are."""
    envs = environments(problem, len(cases), DT)
    policy = method.policy(problem, DT)
    figures = asdict(Performance.of(problem, rollout(envs, policy, cases.parameters), cases.cost))
    if method.planner is not None:
        charged = rollout(envs, policy, cases.parameters, evaluation="goal")
        figures["mean_return"] = Performance.of(problem, charged).mean_return
    envs.close()
    return figures | {"success": figures["success"] / len(cases)}


def chosen_actor(
    problem: OptimalControlProblem, name: str, run: Mapping[str, Any], cases: reference.Reference
) -> dict[str, Any] | None:
    """The shipped actor of the learner ``name`` on the development set, and when in its training it was chosen."""
    if name not in store.available(problem):
        return None
    policy = store.load(problem, name, kind=LearnedPolicy)
    steps = policy.details["steps"]
    curve = dict(zip(run["curves"][0]["steps"], run["curves"][0]["seconds"]))
    development = on_development(problem, Method(name, policy), cases)
    return {"steps": steps, "seconds": curve.get(steps), "development": development}


def shipped_rows(problem: OptimalControlProblem, generation: Any, cases: reference.Reference) -> list[dict[str, Any]]:
    """The shipped networks of the benchmark on the development set, with what they took."""
    rows = []
    for name in benchmark_of(problem).planners.compared:
        if name not in store.available(problem):
            continue
        planner = store.load(problem, name, kind=NetworkPlanner)
        samples, seconds = planner.details["samples"], planner.details["training"]["seconds"]
        budget = None
        if generation is not None:
            budget = PlannerBudget.of(problem, generation, samples, [seconds]).record()
        development = on_development(problem, Method(name, planner), cases)
        rows.append({"name": name, "samples": samples, "budget": budget, "development": development})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--cases", type=int, help="development parameters of the planners; all by default")
    parser.add_argument("--records", type=Path, default=ROOT / "results", help="folder of the records that are read")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    torch.set_num_threads(1)  # the networks are far too small for more
    problem = ocp_envs.load(arguments.env)
    known = reference.load(problem, "development")
    cases = reference.Reference(known.parameters[: arguments.cases], known.mode_costs[: arguments.cases])
    generation = generation_record(arguments.records, problem)
    training = arguments.records / f"compare_training_{problem.id}.json"
    names, count = benchmark_of(problem).planners.compared, len(reference.load(problem, "validation"))
    rows = json.loads(training.read_text()) if training.exists() else {"sizes": [], "rows": []}
    runs = learner_runs(arguments.records, problem)
    # In the order of the comparison.
    learners = {
        name: learner_record(runs[name])
        for name in dict.fromkeys((*benchmark_of(problem).learners.settings, *runs))
        if name in runs
    }
    for name, run in learners.items():
        run["chosen"] = chosen_actor(problem, name, run, cases)
    trajectories, costs = solve_all(problem, cases.parameters, keep=ROOT / "data" / "optimal" / problem.id)
    solved = np.isfinite(costs)  # a level is no method: what was not solved has no optimum to follow
    followed = trajectories[solved]
    known_optima = reference.Reference(cases.parameters[solved], cases.mode_costs[solved])
    optimal = on_development(problem, Method("optimal", lambda p: followed), known_optima)
    record: dict[str, Any] = {
        "env_id": problem.id,
        "given": GIVEN,
        "not_attempted": dict(benchmark_of(problem).learners.unattempted),
        "development": {"set": "development", "count": len(known), "planners": len(cases)},
        "validation": {"set": "validation", "count": count},
        "learners": learners,
        "generation": generation,
        "planners": planner_rows(problem, rows, generation, names, count),
        "shipped": shipped_rows(problem, generation, cases),
        "levels": [{"name": "optimal, tracked", "cases": int(solved.sum()), "development": optimal}],
        "provenance": provenance(),
    }
    record["rows"] = budget_rows(record)
    path = arguments.results / f"budgets_{problem.id}.json"
    write_json(path, record)
    budgets_figure(path.with_suffix(".png"), record)
    missing = "".join(
        f"not attempted: {what}: {why}\n" for what, why in benchmark_of(problem).learners.unattempted.items()
    )
    print(f"{text_table(record['rows'], BUDGET_COLUMNS)}{missing}written to {path} and .png")


if __name__ == "__main__":
    main()
