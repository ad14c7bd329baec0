"""Planning, solving and control steps: how long each takes, compared in one run.

- planners: seconds for each plan, in batches of 1 and of 1,000, and the ratio to solving; the solver, the nearest
  neighbour, the networks, and one solve from the plan of each network;
- solver: from straight lines and random guesses to every winding of the goal (cold), and from the plans of the nearest
  neighbour and of each network (warm): iterations, time, and how often it converges to a verified solution and to the
  best known cost, on the first validation instances; ratios of the time for each instance to that from random guesses;
- steps: a plan, the regulators along it, and each control step after that, also of learners and the stabiliser.

Methods take turns, all on one core. Writes ``benchmark_planning_<env>.json``.

    python scripts/benchmark_planning.py --env GroundVehicle-v0
"""

from moe_policy.experiments import cli
from moe_policy.experiments.latency import BATCHES, PLANNING_COLUMNS, Latency, planner_rows, planning_rows, step_rows
from moe_policy.experiments.methods import one_solve, shipped, stabiliser
from moe_policy.experiments.speed.guesses import SOLVER_COLUMNS, cold, solver_rows, warm
from moe_policy.experiments.speed.solver import ON_ONE_CORE
from moe_policy.reports.tables import text_table
from moe_policy.score.method import Method
from moe_policy.score.optimum import optimal_planner
from ocp_envs.sets import reference
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import provenance

#: Control period, seconds.
DT = 0.02


def main() -> None:
    parser = cli.parser(__doc__, cases="validation instances that are solved", default_cases=200)
    parser.add_argument("--episodes", type=cli.positive, default=10, help="episodes whose control steps are timed")
    arguments = parser.parse()
    cli.threads()
    cli.one_core()

    problem = arguments.problem
    known = reference.load(problem, "validation")
    cli.at_most(arguments.cases, len(known), "validation instances")
    cli.at_most(arguments.episodes, len(known) - 1, "validation instances after the first", "--episodes")
    p, best = known.parameters[: arguments.cases], known.cost[: arguments.cases]
    methods = shipped(problem)
    planners = {method.name: method.planner for method in methods if method.planner is not None}
    with GuardedSolver(problem, ON_ONE_CORE) as solver:
        methods = [Method("optimal", optimal_planner(problem)), *methods, *one_solve(problem, methods, solver)]
        plan = {method.name: method.planner for method in methods if method.planner is not None}
        planned = planner_rows(plan, known.parameters, BATCHES)
        guesses = {"cold, random": cold(problem, "random"), "cold, line": cold(problem, "line")}
        guesses |= {f"warm, {name}": warm(planner) for name, planner in planners.items()}
        solved = solver_rows(solver, guesses, p, best)
        episodes = known.parameters[: arguments.episodes + 1]
        stepped = step_rows(problem, [*methods, *stabiliser(problem)], episodes, DT)
    cli.say(text_table(solved, SOLVER_COLUMNS))
    record = Latency(
        env_id=problem.id, cases=len(p), dt=DT, planners=planned, solver=solved, steps=stepped, provenance=provenance()
    )
    cli.say(text_table(planning_rows(record), PLANNING_COLUMNS))
    cli.publish(arguments, f"benchmark_planning_{problem.id}", record)


if __name__ == "__main__":
    cli.run(main)
