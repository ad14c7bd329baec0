"""Figures of the quadcopter round a sphere: families of optimal paths, and where the optimum flips from one to another.

``around``: optimal paths of the training problems nearest to the start (8, 8, 8) and the sphere at (4, 4, 4) of
radius 3, by the side on which they touch their sphere. ``flip``: the sphere at (0, 4, 4) of radius 3 and starts
(0, 8, z) with z from 6.5 to 9.8, between which the optimum changes from below to above; each family is followed from
the end where it is the best, every solution started from its neighbour's, and the cheaper one counts. Beside the
optimum: the shipped planners of the comparison. Writes ``results/obstacle_around.png``, ``obstacle_flip.png`` and
``obstacle_flip.json``.

    python scripts/draw_obstacle.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import moe_policy
import ocp_envs
from moe_policy.cases import find_flip, flip_parameters, plan_violations
from moe_policy.clustering import cluster
from moe_policy.space_figures import around_figure, flip_figure
from moe_policy.studies import study_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.records import provenance, write_json
from ocp_envs.solver import GuardedSolver
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory

ROOT = Path(__file__).resolve().parents[1]
AROUND = (8.0, 8.0, 8.0, 4.0, 4.0, 4.0, 3.0)
CENTRE, RADIUS, START_XY, HEIGHTS, COUNT = (0.0, 4.0, 4.0), 3.0, (0.0, 8.0), (6.5, 9.8), 12


def follow(problem: OptimalControlProblem, solver: GuardedSolver, p: Array) -> tuple[Trajectory, Array]:
    """The family of the best solution of p[0] along ``p`` (K, np), and its costs (K,); NaN and +inf where it ends."""
    best = ocp_envs.solve(problem, p[0], starts=12)
    plans, costs, guess = [best.trajectory], [best.cost], best.trajectory
    for row in p[1:]:
        found = solver.solve(row[None], guess, np.zeros(1, np.int64))
        plans.append(found.trajectory)
        costs.append(float(found.cost[0]))
        guess = found.trajectory if found.solved[0] else guess
    return Trajectory.concatenate(plans), np.array(costs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the figures")
    arguments = parser.parse_args()

    problem = ocp_envs.load("QuadcopterObstacle-v0")
    study = study_of(problem)
    database = ocp_envs.Database.open(arguments.data / problem.id / "training.zarr", problem)
    samples = database.samples(database.first(study.problems))
    around_figure(arguments.results / "obstacle_around.png", samples, cluster(samples, "custom"), AROUND)

    p = flip_parameters(problem, CENTRE, RADIUS, START_XY, *HEIGHTS, COUNT)
    with GuardedSolver(problem) as solver:
        (rising, up), (falling, down) = (follow(problem, solver, order) for order in (p, p[::-1]))
    down, back = down[::-1], np.arange(COUNT)[::-1]
    cheaper = up <= down
    both = Trajectory.concatenate([rising, falling[back]])
    optimal = both[np.where(cheaper, np.arange(COUNT), COUNT + np.arange(COUNT))]
    plans = {name: moe_policy.load(problem.id, name)(p) for name in study.compared}
    flip_figure(arguments.results / "obstacle_flip.png", problem, p, optimal, plans)
    violations = {name: plan_violations(problem, p, batch) for name, batch in {"optimal": optimal, **plans}.items()}
    flip = find_flip(optimal)
    record = {
        "parameters": p,
        "costs_from_below": [cost if np.isfinite(cost) else None for cost in up],
        "costs_from_above": [cost if np.isfinite(cost) else None for cost in down],
        "flip_after": flip,
        "violations": violations,
        "provenance": provenance(),
    }
    write_json(arguments.results / "obstacle_flip.json", record)
    print(f"the optimum flips between z = {p[flip, 2]:.2f} and {p[flip + 1, 2]:.2f}")
    for name, values in violations.items():
        print(f"{name:15s} worst violation at the knots {values.max():.3f} m")


if __name__ == "__main__":
    main()
