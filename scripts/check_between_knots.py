"""How deep optimal plans violate the path constraint between knots, and what it costs to keep clear there.

Plans keep clear at the knots, or at more points of each interval. Writes ``between_knots_<env>.json``.

    python scripts/check_between_knots.py
"""

import numpy as np

import moe_policy
from moe_policy.experiments import cli
from moe_policy.experiments.between_knots import COLUMNS, BetweenKnots, with_points
from moe_policy.reports.tables import text_table
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance


def main() -> None:
    parser = cli.parser(__doc__, env="QuadcopterObstacle-v0", cases="validation instances", default_cases=100)
    parser.add_argument("--points", nargs="+", type=cli.positive, default=(1, 2, 4), help="of an interval")
    arguments = parser.parse()
    cli.one_core()
    problem = arguments.problem
    if not problem.n_clearances:
        parser.error(f"{problem.id} has no path constraint")
    parameters = reference.load(problem, "validation").parameters
    cli.at_most(arguments.cases, len(parameters), "validation instances")
    parameters = parameters[: arguments.cases]
    plans, costs = moe_policy.load(problem, "optimal", kind=moe_policy.SolverPlanner).best(parameters)
    known = np.isfinite(costs)
    parameters, plans, costs = parameters[known], plans[known], costs[known]
    record = BetweenKnots(
        env_id=problem.id,
        cases=len(parameters),
        rows=tuple(with_points(problem, points, parameters, plans, costs) for points in arguments.points),
        provenance=provenance(),
    )
    cli.publish(arguments, f"between_knots_{problem.id}", record)
    cli.say(text_table(record.rows, COLUMNS))


if __name__ == "__main__":
    cli.run(main)
