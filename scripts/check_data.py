"""Data quality: are the optima we store the best there are, and does every stored trajectory pass the check?

On random problems, fresh or from a database, an exhaustive search (IPOPT alone, from the motions under many random
controls or, where there is an obstacle, from curves that pass it on all sides, to every winding of the goal up to two
beyond the listed ones that lies in the operating box) is compared with the product's ways of solving:
``ocp_envs.solve``, a generated database, and, for fresh problems, warm starts from the training database, for others
what the database holds. A case counts against us where the search is more than 0.1 % (``--tolerance``) cheaper. The
search goes on where it was interrupted.

    python scripts/check_data.py                # writes results/data_quality_<env-id>.json
    python scripts/check_data.py --env GroundVehicle-v0 --cases-from training --starts 40
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import as_completed
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.planners.solver import LOOKAROUND, SolverPlanner
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.splits import split_of
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.guesses import GuessKind, guesses
from ocp_envs.solvers.nlp import SolverSettings, Status
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.files import replacing
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
TOLERANCE = 1e-3
BEYOND = 2
CASES_PER_TASK = 5
#: Iterations of IPOPT in the search: 98 % of the solves that converge at all have done so by then, and the others
#: mostly chase goals out of reach. Sixty starts take the place of patience with one.
ITERATIONS = 100
#: Seed of the cases; no split has it.
SEED = 303


def widened(problem: OptimalControlProblem) -> OptimalControlProblem:
    """The problem with all windings up to ``BEYOND`` further that lie in the operating box."""
    goal, state = problem.goal, problem.system.state
    around = [range(-BEYOND, BEYOND + 1) if period else range(1) for period in state.periods]
    steps = np.stack(np.meshgrid(*around, indexing="ij"), axis=-1).reshape(-1, len(state))
    windings = np.unique((goal.windings[:, None] + steps).reshape(-1, len(state)), axis=0)
    inside = state.contains(goal.state + windings * state.periods)
    return dataclasses.replace(problem, goal=dataclasses.replace(goal, windings=windings[inside]))


@lru_cache(maxsize=1)
def searcher(name: str) -> GuardedSolver:
    """This process's solver of the widened problem."""
    return GuardedSolver(widened(ocp_envs.load(name)), SolverSettings(primary="ipopt", max_iterations=ITERATIONS))


def search(name: str, cases: Array, starts: int, seed: tuple[int, ...]) -> Array:
    """The lowest cost found to every winding, (cases, windings); +inf where none was."""
    solver = searcher(name)
    count, rng = len(solver.problem.targets), np.random.default_rng(seed)
    parameters = np.repeat(cases, count, axis=0)
    windings = np.tile(np.arange(count), len(cases))
    best = np.full(len(parameters), np.inf)
    kind: GuessKind = "bend" if solver.problem.n_clearances else "rollout"
    for _ in range(starts):
        tried = guesses(solver.problem, parameters, windings, rng, kind)
        best = np.minimum(best, solver.solve(parameters, tried, windings, retry_with_fallback=False).cost)
    return best.reshape(len(cases), count)


def exhaustive(problem: OptimalControlProblem, cases: Array, starts: int, workers: int, store: Path) -> Array:
    """Costs of the search, (cases, windings), kept in ``store`` as they come."""
    costs = np.full((len(cases), len(widened(problem).targets)), np.nan)
    key = f"{problem.fingerprint} {starts} {SEED} {ITERATIONS} {hashlib.sha256(cases[:1].tobytes()).hexdigest()}"
    if store.exists():
        with np.load(store, allow_pickle=False) as file:
            if str(file["key"]) == key:  # more cases begin with the same ones
                known = file["costs"][: len(cases)]
                costs[: len(known)] = known
    begins = [i for i in range(0, len(cases), CASES_PER_TASK) if np.isnan(costs[i, 0])]
    searcher(problem.id).start()  # compiles, once, before the workers ask for it
    with (
        WorkerPool(workers) as pool,
        tqdm(total=len(begins), desc="exhaustive search", unit="task", disable=None) as bar,
    ):
        tasks = {pool.submit(search, problem.id, cases[i : i + CASES_PER_TASK], starts, (SEED, i)): i for i in begins}
        for task in as_completed(tasks):
            begin = tasks[task]
            costs[begin : begin + CASES_PER_TASK] = task.result()
            with replacing(store) as file:
                np.savez(file, costs=costs, key=np.array(key))
            bar.update()
    return costs


def draw(
    problem: OptimalControlProblem, databases: dict[str, Database], source: str, count: int
) -> tuple[Array, Array | None]:
    """The cases, and their costs where they come from a database."""
    if source == "fresh":
        return ocp_envs.sample(problem, SEED, count), None
    if source not in databases:
        raise SystemExit(f"--cases-from {source}: there are fresh, {', '.join(databases)}")
    database = databases[source]
    pool = database.first(benchmark_of(problem).training.instances if source == "training" else None)
    rows = np.random.default_rng(SEED).permutation(pool)[:count]
    return database.parameters[rows], database.costs()[rows].min(axis=1)


def by_solve(problem: OptimalControlProblem, cases: Array) -> Array:
    return np.array([ocp_envs.solve(problem, p).cost for p in tqdm(cases, desc="solve", disable=None)])


def by_generate(problem: OptimalControlProblem, cases: Array) -> Array:
    with tempfile.TemporaryDirectory() as folder:
        settings = split_of(problem, "training").settings
        return ocp_envs.generate(problem, Path(folder) / "cases.zarr", cases, settings=settings).costs().min(axis=1)


def compare(ours: Array, costs: Array, cases: Array, targets: Array, tolerance: float) -> dict[str, Any]:
    """How one way of solving does against the search."""
    best = costs.min(axis=1)
    worse = np.flatnonzero(ours > best * (1 + tolerance))
    found = np.isfinite(ours) & np.isfinite(best)
    return {
        "worse": len(worse),
        "share_worse": len(worse) / len(cases),
        "better": int((ours < best * (1 - tolerance)).sum()),
        "unsolved": int((~np.isfinite(ours)).sum()),
        "largest_excess": float((ours[found] / best[found] - 1).max()) if found.any() else None,
        "cases": [
            {
                "parameters": cases[i],
                "ours": float(ours[i]) if np.isfinite(ours[i]) else None,
                "search": float(best[i]),
                "target": targets[costs[i].argmin()],
            }
            for i in worse
        ],
    }


def check_database(database: Database) -> dict[str, int]:
    """The independent check of every trajectory of a database, winners and others."""
    problem = database.problem
    trajectories = failing = 0
    for where, rows in database.blocks():
        row, mode = np.nonzero(np.isfinite(rows.cost) & (rows.status == Status.SOLVED)[:, None])
        trajectory = problem.unflatten(rows.z[row, mode])
        parameters = database.stored_parameters(where)[row]
        passed = verify(problem, parameters, trajectory, rows.cost[row, mode]).passed
        trajectories, failing = trajectories + len(row), failing + int((~passed).sum())
    return {"trajectories": trajectories, "failing": failing, **database.totals()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--cases", type=int, default=500, help="number of random problems")
    parser.add_argument("--cases-from", default="fresh", help="the set they are taken from, such as training")
    parser.add_argument("--starts", type=int, default=60, help="guesses of the search for every winding")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="relative excess that counts")
    parser.add_argument("--ways", nargs="+", help="ways that are compared, such as stored; all by default")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes of the search")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--output", type=Path, help="results/data_quality_<env-id>.json by default")
    arguments = parser.parse_args()

    problem = ocp_envs.load(arguments.env)
    folder = arguments.data / problem.id
    databases = {path.stem: Database.open(path, problem) for path in sorted(folder.glob("*.zarr"))}
    cases, stored = draw(problem, databases, arguments.cases_from, arguments.cases)
    targets = widened(problem).targets
    began = time.perf_counter()
    costs = exhaustive(
        problem, cases, arguments.starts, arguments.workers, folder / f"exhaustive_{arguments.cases_from}.npz"
    )
    seconds = time.perf_counter() - began

    ways: dict[str, Callable[[], Array]] = {
        "solve": lambda: by_solve(problem, cases),
        "generate": lambda: by_generate(problem, cases),
    }
    if stored is not None:
        ways = {"stored": lambda: stored} | ways
    elif "training" in databases:
        planner = SolverPlanner(problem, databases["training"], lookaround=LOOKAROUND)
        ways["warm starts"] = lambda: planner.best(cases)[1]
    if unknown := sorted(set(arguments.ways or ()) - set(ways)):
        parser.error(f"--ways: no {unknown}; there are {sorted(ways)}")
    results = {}
    for name in arguments.ways or ways:
        began = time.perf_counter()
        results[name] = compare(ways[name](), costs, cases, targets, arguments.tolerance) | {
            "seconds": time.perf_counter() - began
        }
        excess = f"{results[name]['worse']} of {len(cases)} cases more than {arguments.tolerance:.1%}"
        print(f"{name}: {excess} above the exhaustive search")
    checks = {name: check_database(database) for name, database in databases.items()}
    for name, check in checks.items():
        print(f"{name}: {check['failing']} of {check['trajectories']} stored trajectories fail the check")
    search_record = {"starts": arguments.starts, "targets": targets, "seconds_of_last_run": seconds, "seed": SEED}
    output = arguments.output or ROOT / "results" / f"data_quality_{problem.id}.json"
    write_json(
        output,
        {
            "problem": problem.id,
            "cases": len(cases),
            "cases_from": arguments.cases_from,
            "tolerance": arguments.tolerance,
            "search": search_record,
            "ways": results,
            "databases": checks,
            "provenance": provenance(),
        },
    )
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
