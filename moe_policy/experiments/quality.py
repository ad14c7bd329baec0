"""Data quality: an exhaustive search, and how the costs that are found otherwise compare with it.

The search runs IPOPT alone, from the motions under random controls or, where there is an obstacle, from curves that
pass it on all sides, to every winding of the goal up to two beyond the listed ones that lies in the operating box.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

import ocp_envs
from moe_policy.experiments.data import contents
from moe_policy.experiments.generation import Totals
from moe_policy.reports.records import ABSENT, Absent, Record, inline, renamed
from ocp_envs.data.database import Database
from ocp_envs.goal import SINGLE_MODE
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import GuessKind, guesses
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.archives import DamagedFileError, read_arrays, write_arrays
from ocp_envs.support.arrays import Array
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import Provenance

BEYOND = 2
CASES_PER_TASK = 5
#: Iterations of IPOPT in the search: 98 % of the solves that converge have done so by then, and most others aim at
#: windings out of reach. Sixty guesses replace patience with one.
ITERATIONS = 100
#: Seed of the instances; no split has it.
SEED = 303


@dataclass(frozen=True, kw_only=True)
class MissedOptimum(Record):
    """An instance whose cost (``None`` where unsolved) exceeds that of the search, which ended at ``target``."""

    parameters: tuple[float, ...]
    ours: float | None
    search: float
    target: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Way(Record):
    """One way of solving, compared with the search: instances that are worse or better by more than the tolerance."""

    worse: int
    share_worse: float
    better: int
    unsolved: int
    largest_excess: float | None
    cases: tuple[MissedOptimum, ...]
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Search(Record):
    """The exhaustive search: number of guesses for each winding, and states of the goal."""

    guesses: int = renamed("starts")
    targets: tuple[tuple[float, ...], ...]
    seconds_of_last_run: float
    seed: int


@dataclass(frozen=True, kw_only=True)
class CheckedDatabase(Record):
    """The independent check of every trajectory in a database."""

    trajectories: int
    failing: int
    totals: Totals = inline()

    @classmethod
    def of(cls, database: Database) -> CheckedDatabase:
        """The check of ``database``."""
        report = contents(database).report
        return cls(trajectories=report.trajectories, failing=report.failing, totals=report.totals)


@dataclass(frozen=True, kw_only=True)
class Quality(Record):
    """Data quality of one problem, by way of solving and by database."""

    env_id: str
    cases: int
    cases_from: str | Absent = ABSENT
    tolerance: float
    search: Search
    ways: dict[str, Way]
    databases: dict[str, CheckedDatabase]
    provenance: Provenance


def widened(problem: OptimalControlProblem) -> OptimalControlProblem:
    """``problem`` with all windings up to :data:`BEYOND` further that lie in the operating box."""
    goal, state = problem.goal, problem.system.state
    around = [range(-BEYOND, BEYOND + 1) if period else range(1) for period in state.periods]
    steps = np.stack(np.meshgrid(*around, indexing="ij"), axis=-1).reshape(-1, len(state))
    windings = np.unique((goal.windings[:, None] + steps).reshape(-1, len(state)), axis=0)
    inside = state.contains(goal.state + windings * state.periods)
    wider = dataclasses.replace(goal, windings=windings[inside])
    return dataclasses.replace(problem, goal=wider, modes=SINGLE_MODE)  # has no family for some of the windings


@lru_cache(maxsize=1)
def _searcher(env_id: str) -> GuardedSolver:
    """This process's solver of the widened problem."""
    return GuardedSolver(widened(ocp_envs.load(env_id)), SolverSettings(primary="ipopt", max_iterations=ITERATIONS))


def _search(env_id: str, cases: Array, count: int, seed: tuple[int, ...]) -> Array:
    """The lowest cost found to every winding, (cases, windings); +inf where none was."""
    solver = _searcher(env_id)
    targets, rng = len(solver.problem.targets), np.random.default_rng(seed)
    parameters = np.repeat(cases, targets, axis=0)
    windings = np.tile(np.arange(targets), len(cases))
    best = np.full(len(parameters), np.inf)
    kind: GuessKind = "bend" if solver.problem.n_clearances else "rollout"
    for _ in range(count):
        tried = guesses(solver.problem, parameters, windings, rng, kind)
        best = np.minimum(best, solver.solve(parameters, tried, windings, retry_with_fallback=False).cost)
    return best.reshape(len(cases), targets)


def exhaustive(problem: OptimalControlProblem, cases: Array, count: int, workers: int | None, store: Path) -> Array:
    """Costs (B, windings) of the search from ``cases`` (B, np) with ``count`` guesses for each winding, +inf if none.

    They are kept in the file ``store``, so that an interrupted search resumes.
    """
    key = f"{problem.fingerprint} {count} {SEED} {ITERATIONS} {hashlib.sha256(cases[:1].tobytes()).hexdigest()}"
    costs = _kept(store, key, (len(cases), len(widened(problem).targets)))
    begins = [i for i in range(0, len(cases), CASES_PER_TASK) if np.isnan(costs[i, 0])]
    _searcher(problem.id).start()  # compiles, once, before the workers need it
    with WorkerPool(workers) as pool:
        tasks = {pool.submit(_search, problem.id, cases[i : i + CASES_PER_TASK], count, (SEED, i)): i for i in begins}
        for task in track(as_completed(tasks), len(tasks), unit="task", label="exhaustive search"):
            begin = tasks[task]
            costs[begin : begin + CASES_PER_TASK] = task.result()
            write_arrays(store, {"costs": costs, "key": np.array(key)})
    return costs


def _kept(store: Path, key: str, shape: tuple[int, int]) -> Array:
    """Costs in ``store`` that were found under ``key``; NaN for all others."""
    costs = np.full(shape, np.nan)
    with contextlib.suppress(DamagedFileError, KeyError):  # missing or damaged: found again
        kept = read_arrays(store)
        known = np.asarray(kept["costs"], dtype=np.float64)[: len(costs)]
        if str(kept["key"]) == key and known.shape[1:] == shape[1:]:  # more instances begin with the same ones
            costs[: len(known)] = known
    return costs


def compare(ours: Array, costs: Array, cases: Array, targets: Array, tolerance: float, seconds: float) -> Way:
    """Costs ``ours`` (B,), +inf where unsolved, against ``costs`` (B, windings) of the search from ``cases`` (B, np).

    ``targets`` (windings, nx) are states of the goal; ``tolerance`` is the relative excess of cost that counts.
    """
    best = costs.min(axis=1)
    worse = np.flatnonzero(ours > best * (1 + tolerance))
    found = np.isfinite(ours) & np.isfinite(best)
    return Way(
        worse=len(worse),
        share_worse=len(worse) / len(cases),
        better=int((ours < best * (1 - tolerance)).sum()),
        unsolved=int((~np.isfinite(ours)).sum()),
        largest_excess=float((ours[found] / best[found] - 1).max()) if found.any() else None,
        cases=tuple(
            MissedOptimum(
                parameters=tuple(cases[i].tolist()),
                ours=float(ours[i]) if np.isfinite(ours[i]) else None,
                search=float(best[i]),
                target=tuple(targets[costs[i].argmin()].tolist()),
            )
            for i in worse
        ),
        seconds=seconds,
    )
