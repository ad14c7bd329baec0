"""Plans that are renewed on the way from the present state, against the plan that is tracked to its end.

From uniform initial conditions and from those near a discontinuity, without a disturbance, under two pushes at random
times, with constants of which the model knows nothing, with wind or with a delay. Changes of the solution family are
compared with those of the solver, restarted from the same states. Latencies are those of one episode at a time. Writes
``replanning_<env>.json``.

    python scripts/compare_replanning.py --env GroundVehicle-v0
    python scripts/compare_replanning.py --cases 50
"""

import time

from moe_policy import store
from moe_policy.experiments import cli
from moe_policy.experiments.disturbed import COUNT, deviations
from moe_policy.experiments.methods import solve_all
from moe_policy.experiments.replanning import REPLANNING_COLUMNS, ReplanningRecord, latency, run_split
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.tables import text_table
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance
from ocp_envs.tables import path_of

DT = 0.02
#: Episodes of which latencies are measured.
EPISODES = 20


def main() -> None:
    parser = cli.parser(
        __doc__, data=True, workers=True, seed=0, cases="initial conditions of each split", default_cases=200
    )
    parser.add_argument(
        "--every", metavar="SECONDS", type=cli.amount, default=0.2, help="time between renewals; default 0.2"
    )
    arguments = parser.parse()
    problem, every, seed = arguments.problem, arguments.every, arguments.seed
    cli.threads()
    names = [name for name in ("moe-custom", "snn") if name in store.available(problem)]
    planner = store.load(problem, names[0], kind=NetworkPlanner)
    began, rows, first = time.process_time(), [], None
    for split in ("validation", "boundary"):
        if not path_of(problem, split).is_file():
            continue
        p = reference.load(problem, split).parameters[: arguments.cases]
        solved, _ = solve_all(problem, p, keep=arguments.data / "optimal" / problem.id, workers=arguments.workers)
        rows += run_split(problem, split, p, solved, planner, every, seed=seed, dt=DT)
        first = first or (p, solved)
    assert first is not None
    record = ReplanningRecord(
        env_id=problem.id,
        cases=arguments.cases,
        seed=seed,
        dt=DT,
        every=every,
        push=deviations(problem),
        pushes=COUNT,
        rows=tuple(rows),
        latency=latency(problem, *first, planner, every, min(EPISODES, arguments.cases), seed=seed, dt=DT),
        cpu_seconds=time.process_time() - began,
        provenance=provenance(),
    )
    cli.publish(arguments, f"replanning_{problem.id}", record)
    cli.say(text_table(record.rows, REPLANNING_COLUMNS))
    for each in record.latency:
        times = f"{each.median:.1f} ms, 99 % {each.percentile_99:.1f} ms of {each.count} renewals"
        cli.say(f"{each.condition}: {times}, at a load of {each.load}")


if __name__ == "__main__":
    cli.run(main)
