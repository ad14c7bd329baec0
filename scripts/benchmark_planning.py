"""Planning, solving and control steps: how long each takes, beside each other in one run.

- planners: seconds a plan, in batches of 1 and of 1,000, and the ratio to solving;
- solver: from straight lines and random guesses to every winding of the goal (cold), and from the plans of the nearest
  neighbour and of each network (warm): iterations, time, how often it converges to a verified solution and how often to
  the best known cost, on the first validation problems; ratios of time a problem to the cold random start;
- steps: a plan, the regulators along it, and each control step after that, beside learners and the stabiliser.

What is compared takes turns. All on one core. Writes ``results/benchmark_planning_<env>.json``.

    python scripts/benchmark_planning.py --env GroundVehicle-v0
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import torch

import ocp_envs
from moe_policy.experiments.latency import (
    BATCHES,
    PLANNING_COLUMNS,
    SOLVER_COLUMNS,
    cold,
    planner_rows,
    planning_rows,
    solver_rows,
    step_rows,
    warm,
)
from moe_policy.experiments.methods import optimal_planner, shipped, stabiliser
from moe_policy.experiments.tables import text_table
from ocp_envs.sets import reference
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
DT = 0.02


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--cases", type=int, default=200, help="validation problems that are solved")
    parser.add_argument("--episodes", type=int, default=10, help="episodes whose steps are timed")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # the solver's child inherits it: one core for both

    problem = ocp_envs.load(arguments.env)
    known = reference.load(problem, "validation")
    p, best = known.parameters[: arguments.cases], known.cost[: arguments.cases]
    everyone = shipped(problem)
    planners = {method.name: method.planner for method in everyone if method.planner is not None}

    planned = planner_rows({"optimal": optimal_planner(problem), **planners}, known.parameters, BATCHES)
    # On a core of its own a solve that takes a second hangs.
    with GuardedSolver(problem, SolverSettings(hang_factor=25.0, hang_floor=1.0)) as solver:
        starts = {"cold, random": cold(problem, "random"), "cold, line": cold(problem, "line")}
        starts |= {f"warm, {name}": warm(planner) for name, planner in planners.items()}
        solved = solver_rows(problem, solver, starts, p, best)
    print(text_table(solved, SOLVER_COLUMNS))

    stepped = step_rows(problem, [*everyone, *stabiliser(problem)], known.parameters[: arguments.episodes + 1], DT)
    record = {"env_id": problem.id, "cases": len(p), "dt": DT}
    record |= {"planners": planned, "solver": solved, "steps": stepped, "provenance": provenance()}
    print(text_table(planning_rows(record), PLANNING_COLUMNS))
    write_json(arguments.results / f"benchmark_planning_{problem.id}.json", record)


if __name__ == "__main__":
    main()
