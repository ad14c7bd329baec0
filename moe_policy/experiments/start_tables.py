"""Tables from which parameters are drawn where drawing takes an optimiser: optimal paths, and initial conditions."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from moe_policy.experiments.records import ABSENT, Absent, Record
from ocp_envs import tables
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import free_paths
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance

#: Seeds of the initial conditions, of the paths in the table, and of those on which its error is measured.
STARTS, PATHS, FRESH = 303, 403, 404
_BLOCK = 500


@dataclass(frozen=True, kw_only=True)
class StartTables(Record):
    """How the tables of a problem were made.

    ``errors``: quantiles of the error of interpolated paths on ``fresh`` ones, metres; ``largest_ratio``: of that error
    to the difference of two interpolations; ``mean_tolerance``: mean error that is assumed of a path, metres.
    """

    paths: int | Absent = ABSENT
    fresh: int | Absent = ABSENT
    errors: dict[str, float] | Absent = ABSENT
    solves_per_second: float | Absent = ABSENT
    starts: int | Absent = ABSENT
    seed: int | Absent = ABSENT
    starts_per_second: float | Absent = ABSENT
    largest_ratio: float | Absent = ABSENT
    mean_tolerance: float | Absent = ABSENT
    provenance: Provenance

    def with_paths(
        self, problem: OptimalControlProblem, size: int, fresh: int, say: Callable[[str], None] = print
    ) -> StartTables:
        """Solve ``size`` of the free problem's optimal paths and write them into the package; the new record.

        The error of the table is measured on ``fresh`` others.
        """
        free = free_paths.blocked(problem).free
        p, others = sample(free, PATHS, size), sample(free, FRESH, fresh)
        with GuardedSolver(free) as solver:
            solver.start()
            began = time.perf_counter()
            found, solved = _spines(problem, p, solver), _spines(problem, others, solver)
            seconds = time.perf_counter() - began
        found = found.astype(np.float32).astype(np.float64)
        table = free_paths.measured(free_paths.PathTable(free.parameters.width, p, found), others, solved)
        say(f"wrote {free_paths.ship(problem, table)}; the maximum error of interpolated paths is {table.error:.2g} m")
        paths, difference = table(others)
        errors = free_paths.distance(paths, free_paths.dense(solved))
        return replace(
            self,
            paths=size,
            fresh=fresh,
            errors={f"{level:g}": float(np.quantile(errors, level)) for level in (0.5, 0.9, 0.99, 1.0)},
            largest_ratio=table.ratio,
            mean_tolerance=float(table.tolerance(difference).mean()),
            solves_per_second=(size + fresh) / seconds,
        )

    def with_starts(
        self, problem: OptimalControlProblem, size: int, workers: int | None, say: Callable[[str], None] = print
    ) -> StartTables:
        """Draw ``size`` initial conditions and write them into the package; the new record."""
        began = time.perf_counter()
        parameters = sample(problem, STARTS, size, workers=workers)
        seconds = time.perf_counter() - began
        say(f"wrote {tables.save(problem, tables.STARTS, parameters=parameters)} in {seconds:.1f} s")
        return replace(self, starts=size, seed=STARTS, starts_per_second=size / seconds)


def _spines(problem: OptimalControlProblem, parameters: Array, solver: GuardedSolver) -> Array:
    """Spines of the free problem's optimal paths."""
    blocks = np.array_split(parameters, max(1, len(parameters) // _BLOCK))
    parts = [free_paths.solve_free(problem, block, solver) for block in tqdm(blocks, desc="paths")]
    return np.concatenate([free_paths.spines(problem, part) for part in parts])
