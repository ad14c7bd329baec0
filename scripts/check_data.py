"""Data quality: are the stored optima the best there are, and does every stored trajectory pass the check?

On random instances, fresh or from a database, an exhaustive search is compared with the ways of solving here:
``ocp_envs.solve``, a generated database, and for fresh instances warm starts from the training database, for others the
costs that the database holds. An instance counts as worse where the search is more than 0.1 % (``--tolerance``)
cheaper. An interrupted search resumes. Writes ``data_quality_<env>.json``.

    python scripts/check_data.py
    python scripts/check_data.py --env GroundVehicle-v0 --cases-from training --guesses 40
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.quality import SEED, CheckedDatabase, Quality, Search, compare, exhaustive, widened
from moe_policy.planners.solver import SolverPlanner
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance

#: Relative excess of cost from which an instance counts as worse.
TOLERANCE = 1e-3


def draw(
    problem: OptimalControlProblem, databases: dict[str, Database], source: str, count: int
) -> tuple[Array, Array | None]:
    """Parameters of the instances, and their costs where they come from the database ``source``."""
    if source == "fresh":
        return ocp_envs.sample(problem, SEED, count), None
    if source not in databases:
        raise cli.UsageError(f"--cases-from {source}: there are fresh, {', '.join(databases)}")
    database = databases[source]
    pool = database.first(benchmark_of(problem).training.instances if source == "training" else None)
    cli.at_most(count, len(pool), f"instances in {source}")
    rows = np.random.default_rng(SEED).permutation(pool)[:count]
    return database.parameters[rows], database.costs()[rows].min(axis=1)


def by_solve(problem: OptimalControlProblem, cases: Array) -> Array:
    """Costs of ``ocp_envs.solve``."""
    shown = track(cases, len(cases), unit="instance", label="solve")
    return np.array([ocp_envs.solve(problem, p).cost for p in shown])


def by_generate(problem: OptimalControlProblem, cases: Array) -> Array:
    """Costs of a generated database."""
    with tempfile.TemporaryDirectory() as folder:
        settings = sets_of(problem).training.settings
        return ocp_envs.generate(problem, Path(folder) / "cases.zarr", cases, settings=settings).costs().min(axis=1)


def ways_of(
    problem: OptimalControlProblem, databases: dict[str, Database], cases: Array, stored: Array | None
) -> dict[str, Callable[[], Array]]:
    """Ways of solving ``cases`` by name."""
    ways: dict[str, Callable[[], Array]] = {
        "solve": lambda: by_solve(problem, cases),
        "generate": lambda: by_generate(problem, cases),
    }
    if stored is not None:
        return {"stored": lambda: stored} | ways
    if "training" in databases:
        ways["warm starts"] = lambda: SolverPlanner(problem, databases["training"]).best(cases)[1]
    return ways


def parse() -> argparse.Namespace:
    parser = cli.parser(__doc__, data=True, workers=True, cases="instances", default_cases=500)
    parser.add_argument("--cases-from", default="fresh", help="the set they are taken from, such as training")
    parser.add_argument("--guesses", type=cli.positive, default=60, help="guesses of the search for every winding")
    parser.add_argument("--tolerance", type=cli.amount, default=TOLERANCE, help="relative excess of cost that counts")
    parser.add_argument("--ways", nargs="+", help="ways that are compared, such as stored; all by default")
    return parser.parse()


def main() -> None:
    arguments = parse()
    problem, folder, tolerance = arguments.problem, arguments.data / arguments.problem.id, arguments.tolerance
    databases = {path.stem: Database.open(path, problem) for path in sorted(folder.glob("*.zarr"))}
    cases, stored = draw(problem, databases, arguments.cases_from, arguments.cases)
    ways, targets = ways_of(problem, databases, cases, stored), widened(problem).targets
    if unknown := sorted(set(arguments.ways or ()) - set(ways)):
        raise cli.UsageError(f"--ways: no {unknown}; there are {sorted(ways)}")
    began, store = time.perf_counter(), folder / f"exhaustive_{arguments.cases_from}.npz"
    costs = exhaustive(problem, cases, arguments.guesses, arguments.workers, store)
    seconds = time.perf_counter() - began
    compared = {}
    for name in arguments.ways or ways:
        began = time.perf_counter()
        ours = ways[name]()
        compared[name] = compare(ours, costs, cases, targets, tolerance, time.perf_counter() - began)
        cli.say(f"{name}: {compared[name].worse} of {len(cases)} instances more than {tolerance:.1%} above the search")
    checks = {name: CheckedDatabase.of(database) for name, database in databases.items()}
    for name in checks:
        cli.say(f"{name}: {checks[name].failing} of {checks[name].trajectories} stored trajectories fail the check")
    record = Quality(
        env_id=problem.id,
        cases=len(cases),
        cases_from=arguments.cases_from,
        tolerance=tolerance,
        search=Search(
            guesses=arguments.guesses,
            targets=tuple(map(tuple, targets.tolist())),
            seconds_of_last_run=seconds,
            seed=SEED,
        ),
        ways=compared,
        databases=checks,
        provenance=provenance(),
    )
    cli.publish(arguments, f"data_quality_{problem.id}", record)


if __name__ == "__main__":
    cli.run(main, continues=True)
