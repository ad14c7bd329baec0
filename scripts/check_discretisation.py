"""How much optimal plans cost more than the optimum in continuous time, as a consequence of their grid.

Plans of the shipped solver planner from validation instances are compared with optima on finer grids and with
Hermite-Simpson collocation. Writes ``discretisation_<env>.json``.
"""

import time

import numpy as np

import moe_policy
from moe_policy.experiments import cli
from moe_policy.experiments.discretisation import COLUMNS, Discretisation, estimates, excess
from moe_policy.reports.tables import text_table
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance


def measure(problem: OptimalControlProblem, cases: int) -> Discretisation:
    began = time.perf_counter()
    parameters = reference.load(problem, "validation").parameters
    cli.at_most(cases, len(parameters), "validation instances")
    parameters = parameters[:cases]
    plans, costs = moe_policy.load(problem, "optimal", kind=moe_policy.SolverPlanner).best(parameters)
    solved = np.isfinite(costs)
    parameters, plans, costs = parameters[solved], plans[solved], costs[solved]
    found = estimates(problem, parameters, plans)
    return Discretisation(
        env_id=problem.id,
        cases=len(parameters),
        intervals=problem.knots - 1,
        rows=tuple(excess(name, intervals, costs, optimum) for name, (intervals, optimum) in found.items()),
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )


def main() -> None:
    arguments = cli.parser(__doc__, cases="validation instances", default_cases=40).parse()
    problem = arguments.problem
    record = measure(problem, arguments.cases)
    cli.publish(arguments, f"discretisation_{problem.id}", record)
    cli.say(f"{problem.id}: plans of {record.intervals} intervals, {record.cases} instances")
    cli.say(text_table(record.rows, COLUMNS))
    cli.say(f"{record.seconds:.0f} s")


if __name__ == "__main__":
    cli.run(main)
