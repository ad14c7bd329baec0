"""Make the tables from which parameters are drawn where drawing takes an optimiser, and write them into the package.

``reference/<env-id of the free problem>/paths.npz``: optimal paths of the problem without its path constraint, in which
others are interpolated, with the largest error over fresh ones. ``reference/<env-id>/starts.npz``: parameters among
which ``env.reset()`` draws, with a seed of their own. What it took goes to ``results/starts_<env-id>.json``. A table
that is there and fits is kept, so the same command goes on after an interruption.

    python scripts/make_starts.py --env QuadcopterObstacle-v0
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import ocp_envs
from ocp_envs import tables
from ocp_envs.distribution import Blocked
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import free_paths
from ocp_envs.sets.sampling import sample
from ocp_envs.sets.splits import splits_of
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
#: Seeds of the starts, of the paths in the table, and of those its error is measured on.
STARTS, PATHS, FRESH = 303, 403, 404
_BLOCK = 500


def solve(problem: OptimalControlProblem, parameters: Array, solver: GuardedSolver) -> Array:
    """Spines of the free problem's optimal paths."""
    blocks = np.array_split(parameters, max(1, len(parameters) // _BLOCK))
    parts = [free_paths.solve_free(problem, block, solver) for block in tqdm(blocks, desc="paths")]
    return np.concatenate([free_paths.spines(problem, part) for part in parts])


def make_paths(problem: OptimalControlProblem, size: int, fresh: int) -> dict[str, Any]:
    """Solve and write the table of paths; its record."""
    free = free_paths.blocked(problem).free
    p, others = sample(free, PATHS, size), sample(free, FRESH, fresh)
    with GuardedSolver(free) as solver:
        solver.start()
        began = time.perf_counter()
        found, solved = solve(problem, p, solver), solve(problem, others, solver)
        seconds = time.perf_counter() - began
    found = found.astype(np.float32).astype(np.float64)
    table = free_paths.measured(free_paths.PathTable(free.parameters.width, p, found), others, solved)
    print(f"wrote {free_paths.ship(problem, table)}; interpolated paths are off by up to {table.error:.2g}")
    paths, difference = table(others)
    errors = free_paths.distance(paths, free_paths.dense(solved))
    quantiles = {f"{level:g}": float(np.quantile(errors, level)) for level in (0.5, 0.9, 0.99, 1.0)}
    return {
        "paths": size,
        "fresh": fresh,
        "errors": quantiles,
        "largest_ratio": table.ratio,
        "mean_tolerance": float(table.tolerance(difference).mean()),
        "solves_per_second": (size + fresh) / seconds,
    }


def make_starts(problem: OptimalControlProblem, size: int, workers: int | None) -> dict[str, Any]:
    """Draw and write the table of starts; its record."""
    began = time.perf_counter()
    parameters = sample(problem, STARTS, size, workers=workers)
    seconds = time.perf_counter() - began
    print(f"wrote {tables.save(problem, tables.STARTS, parameters=parameters)} in {seconds:.1f} s")
    return {"starts": size, "seed": STARTS, "starts_per_second": size / seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="QuadcopterObstacle-v0", help="name of the environment")
    parser.add_argument("--starts", type=int, default=10_000, help="parameters in the table of starts")
    parser.add_argument("--paths", type=int, default=5_000, help="paths in the table of paths")
    parser.add_argument("--fresh", type=int, default=1_000, help="paths that the interpolation is measured on")
    parser.add_argument("--workers", type=int, default=1, help="processes that draw starts")
    parser.add_argument("--again", action="store_true", help="make tables anew that are there already")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the record")
    arguments = parser.parse_args()

    problem = ocp_envs.load(arguments.env)
    if not isinstance(problem.distribution, Blocked):
        raise SystemExit(f"{problem.id} draws its starts uniformly and needs no tables")
    if STARTS in {split.seed for split in splits_of(problem).values()}:
        raise SystemExit(f"seed {STARTS} of the starts is that of a split")
    record: dict[str, Any] = {}
    if arguments.again or free_paths.shipped(problem) is None:
        record |= make_paths(problem, arguments.paths, arguments.fresh)
        free_paths.shipped.cache_clear()
    try:
        if arguments.again:
            raise tables.TableError
        tables.starts(problem)
    except tables.TableError:
        record |= make_starts(problem, arguments.starts, arguments.workers)
    path = arguments.results / f"starts_{problem.id}.json"
    if record:
        earlier = json.loads(path.read_text()) if path.exists() else {}
        write_json(path, earlier | record | {"provenance": provenance()})


if __name__ == "__main__":
    main()
