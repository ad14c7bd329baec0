"""Solves from different guesses: how long they take, and how often they end at the best known cost.

Kinds of guesses take turns, a few instances at a time, so that other load on the machine affects all of them.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from moe_policy.protocols import Planner
from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column, duration
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING, guesses, random_kind
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.trajectory import Trajectory

#: Instances that are solved from one kind of guess before the next kind takes its turn.
TURN = 10
#: Relative excess of cost below which a solution counts as the best known one.
SAME = 1e-3
#: p (B, np) → row of p, guess and index of the goal's winding (−1: the one nearest to the guess's end) of every solve.
Guess = Callable[[Array], tuple[Ints, Trajectory, Ints]]


@dataclass(frozen=True, kw_only=True)
class SolveRow(Record):
    """Solves from one kind of guess.

    ``best_known``: instances whose cheapest solution costs no more than the best known one. ``seconds_per_problem``:
    wall time for each instance, guesses, hung solves and checks included; ``ratio``: that from the first kind / from
    this one. Medians are over verified solves, ``None`` without any.
    """

    name: str
    problems: int
    solves: int
    verified: int
    hung: int
    solved_problems: int
    best_known: int
    iterations_median: float | None
    milliseconds_median: float | None
    seconds_per_problem: float
    ratio: float


def median_of(values: Sequence[float] | Array) -> float | None:
    """The median of ``values``; ``None`` without any."""
    return float(np.median(values)) if len(values) else None


def cold(problem: OptimalControlProblem, kind: str, seed: int = 0) -> Guess:
    """A guess of ``kind`` "line" or "random" for every winding of the goal, as in multistart."""

    def guess(p: Array) -> tuple[Ints, Trajectory, Ints]:
        count = len(problem.targets)
        rows, windings = np.repeat(np.arange(len(p)), count), np.tile(np.arange(count), len(p))
        rng = np.random.default_rng((seed, *p[0].view(np.uint64).tolist()))
        drawn = "line" if kind == "line" else random_kind(problem)
        return rows, guesses(problem, p[rows], windings, rng, drawn), windings

    return guess


def warm(planner: Planner) -> Guess:
    """The plan of ``planner``, for the winding of the goal nearest to its end."""

    def guess(p: Array) -> tuple[Ints, Trajectory, Ints]:
        return np.arange(len(p)), planner(p), np.full(len(p), NEAREST_WINDING)

    return guess


@dataclass(frozen=True, eq=False)
class _Turn:
    """Solves of a few instances from one kind of guess; arrays by solve, ``cheapest`` by instance."""

    solved: Bools
    iterations: Ints
    solve_seconds: Array
    cheapest: Array
    seconds: float
    hung: int


def _turn(solver: GuardedSolver, guess: Guess, p: Array) -> _Turn:
    restarts, began = solver.restarts, time.perf_counter()
    rows, guessed, windings = guess(p)
    found = solver.solve(p[rows], guessed, windings, retry_with_fallback=False)
    seconds, hung = time.perf_counter() - began, solver.restarts - restarts
    cheapest = np.full(len(p), np.inf)
    np.minimum.at(cheapest, rows, found.cost)
    return _Turn(found.solved, np.asarray(found.iterations, np.int64), found.seconds, cheapest, seconds, hung)


def solver_rows(solver: GuardedSolver, kinds: Mapping[str, Guess], p: Array, best: Array) -> tuple[SolveRow, ...]:
    """Solves of ``p`` (B, np) from each kind of guess, and how often they end at the ``best`` known costs (B,)."""
    for guess in kinds.values():  # a first few solves warm up
        _turn(solver, guess, p[:2])
    turns: dict[str, list[_Turn]] = defaultdict(list)
    for begin in range(0, len(p), TURN):
        for name, guess in kinds.items():
            turns[name].append(_turn(solver, guess, p[begin : begin + TURN]))
    seconds = {name: sum(turn.seconds for turn in own) / len(p) for name, own in turns.items()}
    first = seconds[next(iter(kinds))]
    return tuple(_solve_row(name, own, best, seconds[name], first / seconds[name]) for name, own in turns.items())


def _solve_row(name: str, turns: Sequence[_Turn], best: Array, seconds: float, ratio: float) -> SolveRow:
    solved = np.concatenate([turn.solved for turn in turns])
    cheapest = np.concatenate([turn.cheapest for turn in turns])
    iterations = np.concatenate([turn.iterations for turn in turns])[solved].astype(np.float64)
    milliseconds = 1e3 * np.concatenate([turn.solve_seconds for turn in turns])[solved]
    return SolveRow(
        name=name,
        problems=len(best),
        solves=len(solved),
        verified=int(solved.sum()),
        hung=sum(turn.hung for turn in turns),
        solved_problems=int(np.isfinite(cheapest).sum()),
        best_known=int((cheapest <= best * (1 + SAME)).sum()),
        iterations_median=median_of(iterations),
        milliseconds_median=median_of(milliseconds),
        seconds_per_problem=seconds,
        ratio=ratio,
    )


SOLVER_COLUMNS: tuple[Column[SolveRow], ...] = (
    Column("guess", lambda row: row.name),
    Column("solves", lambda row: row.solves, "d"),
    Column("verified", lambda row: row.verified, "d"),
    Column("hung", lambda row: row.hung, "d"),
    Column("instances", lambda row: row.problems, "d"),
    Column("at the best known cost", lambda row: row.best_known, "d"),
    Column("iterations", lambda row: row.iterations_median, ".0f"),
    Column("ms a solve", lambda row: row.milliseconds_median, ".2f"),
    Column("an instance", lambda row: row.seconds_per_problem, duration),
    Column("cold time / its time", lambda row: row.ratio, ".2f"),
)
