"""How many guesses and warm starts generation needs: solves, rate and missed optima by setting.

The same random instances are generated with one setting changed at a time. An instance counts as missed where its cost
is more than 0.1 % above the lowest that any row found; the thorough row finds what the others miss. Databases of the
full size have nearer neighbours than these, so they miss less. Writes ``benchmark_generation_<env>.json``, or with
``--solvers``, which compares the solvers instead, ``benchmark_generation_solvers_<env>.json``.

    python scripts/benchmark_generation.py --env GroundVehicle-v0
    python scripts/benchmark_generation.py --env GroundVehicle-v0 --solvers
"""

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.speed.generation import (
    TOLERANCE,
    GenerationSpeed,
    compare,
    measure,
    settings_by_name,
    solvers_by_name,
)
from ocp_envs.support.provenance import provenance

#: Seed of the instances; no split has it.
SEED = 404


def main() -> None:
    parser = cli.parser(__doc__, cases="instances of every row", default_cases=3000)
    parser.add_argument("--solvers", action="store_true", help="compare the solvers instead of the settings")
    arguments = parser.parse()
    problem, runs = arguments.problem, {}
    p = ocp_envs.sample(problem, SEED, arguments.cases)
    for name, settings in (solvers_by_name() if arguments.solvers else settings_by_name()).items():
        runs[name] = measure(problem, p, settings)
        cli.say(f"{name}: {runs[name].rate:.1f} instances per second")
    rows = compare(runs)
    cli.say(f"\n{'':40s} {'solves':>7s} {'ratio':>6s} {'missed':>7s}")
    for name, row in rows.items():
        cli.say(f"{name:40s} {row.solves_per_problem:7.1f} {row.rate_to_default:6.2f} {row.missed:7d}")
    record = GenerationSpeed(
        env_id=problem.id, problems=len(p), seed=SEED, tolerance=TOLERANCE, rows=rows, provenance=provenance()
    )
    cli.publish(arguments, f"benchmark_generation_{'solvers_' * arguments.solvers}{problem.id}", record)


if __name__ == "__main__":
    cli.run(main)
