"""Verified solutions per second: the solver of this package against plain CasADi ``Opti`` with IPOPT.

All get the same instances, guesses and nonlinear program (every winding of the goal is one solve), tolerance 1e-6 and
one core; ``Opti`` is built once and gets its parameters for each solve. Everything is timed: the guard, all attempts,
the transfer and the independent check. Building and compiling come before and are reported separately. Our solver runs
as in multistart, which tries another guess rather than the fallback where a solve did not converge; with fatrop as
primary solver ("ours") and with the interior-point method in C ("riccati").

Guesses: straight lines, random ones (cold), the solution of the nearest of ``--stored`` solved instances (warm), and a
linear fit through the nearest of them (fit). The ratio "plain" is what a user of ``Opti`` gains: our highest rate
against the highest of ``Opti`` without a warm start. Writes ``benchmark_solver_<env>.json``.

    python scripts/benchmark_solver.py
"""

import time
from functools import partial

from moe_policy.experiments import cli
from moe_policy.experiments.speed.solver import (
    KINDS,
    ON_ONE_CORE,
    RICCATI,
    PlainOpti,
    Solve,
    SolverSpeed,
    all_guesses,
    compare,
    draw,
    plain_ratio,
)
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import provenance


def main() -> None:
    parser = cli.parser(__doc__, seed=20190622, cases="instances", default_cases=200)
    parser.add_argument("--stored", type=cli.positive, default=500, help="solved instances for warm starts")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="guesses; all by default")
    parser.add_argument("--rounds", type=cli.positive, default=3, help="the fastest of so many rounds counts")
    arguments = parser.parse()
    cli.one_core()

    problem, seed, tolerance = arguments.problem, arguments.seed, ON_ONE_CORE.tolerance
    parameters, windings = draw(problem, arguments.cases, seed)
    compared = {}
    with GuardedSolver(problem, ON_ONE_CORE) as ours, GuardedSolver(problem, RICCATI) as riccati:
        began = time.perf_counter()
        ours.start()
        start_seconds = time.perf_counter() - began
        riccati.start()
        solvers: dict[str, Solve] = {
            name: partial(one.solve, retry_with_fallback=False) for name, one in (("ours", ours), ("riccati", riccati))
        }
        for name, expand in (("opti", False), ("opti_expanded", True)):
            solvers[name] = PlainOpti(problem, tolerance, expand).solve
        guesses = all_guesses(problem, ours.solve, parameters, arguments.stored, seed)
        for kind in arguments.kinds:
            compared[kind] = compare(solvers, arguments.rounds, parameters, guesses[kind], windings)
            cli.say(compared[kind].text(kind))
    record = SolverSpeed(
        env_id=problem.id,
        seed=seed,
        parameters=arguments.cases,
        rounds=arguments.rounds,
        solves=len(parameters),
        tolerance=tolerance,
        stored=arguments.stored,
        start_seconds=start_seconds,
        **compared,
        plain=plain_ratio(compared),
        plain_riccati=plain_ratio(compared, "riccati"),
        provenance=provenance(),
    )
    cli.publish(arguments, f"benchmark_solver_{problem.id}", record)
    if record.plain:
        cli.say(
            "our highest rates to the highest of Opti without a warm start: "
            f"{record.plain:.1f}, {record.plain_riccati:.1f}"
        )


if __name__ == "__main__":
    cli.run(main)
