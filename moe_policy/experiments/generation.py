"""Records of how the databases, the hard sets and the tables of a problem were made, and the making of the tables.

Drawing from tables serves problems where a draw takes an optimiser: optimal paths, and initial conditions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from moe_policy.reports.records import ABSENT, Absent, Record, inline, renamed
from ocp_envs import tables
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import free_paths
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import Provenance, peak_memory_gb

#: Seeds of the initial conditions, of the paths in the table, and of those on which its error is measured.
STARTS, PATHS, FRESH = 303, 403, 404
_BLOCK = 500


@dataclass(frozen=True, kw_only=True)
class Totals(Record):
    """What solving took: sums over the instances in a database."""

    problems: int  # instances whose chunk is complete
    solved: int  # those with a solution
    solves: int  # attempts to solve them
    failures: int  # attempts without a verified solution
    fallbacks: int  # attempts that went to the second solver
    iterations: int  # of all attempts

    @classmethod
    def of(cls, database: Database) -> Totals:
        """The totals of ``database``."""
        return cls(**database.totals())


@dataclass(frozen=True, kw_only=True)
class Memory(Record):
    """Maximum memory in GB: of the process that generates, of its largest descendant, and a bound of all together."""

    parent_gb: float
    largest_child_gb: float
    bound_gb: float

    @classmethod
    def peak(cls, workers: int) -> Memory:
        """The maximum so far, with ``workers`` processes of which each has a child that solves."""
        own, largest = peak_memory_gb(), peak_memory_gb(descendants=True)
        return cls(parent_gb=own, largest_child_gb=largest, bound_gb=own + 2 * workers * largest)


@dataclass(frozen=True, kw_only=True)
class SplitGeneration(Record):
    """How the database of one split was generated.

    ``resumed_from``: instances that were solved before the last run, whose duration is ``seconds``; ``workers``:
    processes, or threads of a cluster, whose memory is not counted.
    """

    totals: Totals = inline()
    seconds: float
    problems_per_second: float
    resumed_from: int
    workers: int
    cluster: bool | Absent = ABSENT
    settings: object
    digest: str
    memory: Memory
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class Generation(Record):
    """How the databases of a problem were generated, by split."""

    splits: dict[str, SplitGeneration] = inline()


@dataclass(frozen=True, kw_only=True)
class SearchReport(Record):
    """How the exhaustive search compares with the choice of the candidates."""

    tolerance: float  # relative difference from which two costs count as different
    compared: int  # candidates for which both have costs
    found_better: int  # those for which the search found a lower cost
    missed: int  # those for which it found a higher one


@dataclass(frozen=True, kw_only=True)
class HardSetReport(Record):
    """How one hard set was made (:func:`ocp_envs.sets.making.make`)."""

    seed: int  # of the draw and of the guesses
    size: int  # number of instances
    drawn: int | Absent = ABSENT  # number of uniform draws
    slack: float | Absent = ABSENT  # maximum relative cost difference of a candidate
    within_slack: int | Absent = ABSENT  # number of draws within it
    limit: float | Absent = ABSENT  # maximum distance from the discontinuity
    fraction_within_limit: float | Absent = renamed("share_within_limit", ABSENT)  # of the draws
    beyond: tuple[float, float] | Absent = ABSENT  # minimum and maximum excess beyond the box, in half widths
    fraction: float | Absent = ABSENT  # of the width of the parameter box, towards the goal
    coordinates: tuple[str, ...] | Absent = ABSENT  # those that are confined to it
    candidates: int  # number of instances that were solved
    confirmed: int  # those that meet the condition
    unsolved: int  # those without a solution
    guesses_per_winding: int  # of the exhaustive search
    search: SearchReport | None  # compared with the choice of the candidates; ``None`` where that solves nothing
    solves: Totals  # of the candidates
    settings: object  # of the generation
    seconds: float  # duration of the run
    resumed: bool  # whether an earlier run had begun
    workers: int | None  # processes; ``None`` for one per core
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class HardSets(Record):
    """How the hard sets of a problem were made: ``splits_<env>.json``."""

    sets: dict[str, HardSetReport] = inline()  # by name


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
        stored = free_paths.PathTable(free.parameters.width, p, free_paths.as_stored(found))
        table = free_paths.measured(stored, others, solved)
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
    shown = track(blocks, len(blocks), unit="block", label="paths")
    parts = [free_paths.solve_free(problem, block, solver) for block in shown]
    return np.concatenate([free_paths.spines(problem, part) for part in parts])
