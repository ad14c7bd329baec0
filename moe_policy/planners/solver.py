"""The nonlinear program as a planner: solved from several guesses, the cheapest verified solution is the plan."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType, NoneType
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.owner import check_owner, plans_of
from moe_policy.protocols import Planner
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.guesses import NEAREST_WINDING, GuessKind, guesses, random_kind
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.checks import check_kind, check_whole
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: Number of nearest samples considered as warm starts, and the problems with a number of their own: round the sphere
#: a solve takes long, and there are two of them for every instance.
LOOKAROUND = 12
LOOKAROUND_OF: Mapping[str, int] = MappingProxyType({"QuadcopterObstacle-v0": 2})
#: Random guesses for each winding of the goal where there are no warm starts.
RANDOM_GUESSES = 8


def lookaround_of(problem: OptimalControlProblem) -> int:
    """Number of nearest samples among which the warm starts of ``problem`` are looked for by default."""
    return LOOKAROUND_OF.get(problem.id, LOOKAROUND)


@runtime_checkable
class BatchSolver(Protocol):
    """What solves a batch of problem instances from one guess each, as ``GuardedSolver`` of ``ocp_envs`` does."""

    def solve(
        self, parameters: Array, guesses: Trajectory, windings: NDArray[np.integer], *, retry_with_fallback: bool = True
    ) -> Solutions:
        """Solve B instances, each from one guess.

        Args:
            parameters: (B, np).
            guesses: B trajectories.
            windings: (B,) indices into ``problem.targets``, or ``NEAREST_WINDING``.
            retry_with_fallback: whether the fallback solver retries where the primary one did not converge.
        """


@dataclass(frozen=True, eq=False)
class _Attempts(Batch):
    """Guesses for some of B instances: the instance's row, the guess and the winding of each."""

    row: Ints
    guess: Trajectory
    winding: Ints


class SolverPlanner:
    """Plans by solving the nonlinear program.

    For every p the solver is warm-started from samples in ``database``: among the ``lookaround`` nearest ones, the
    ``neighbours`` nearest of every solution family that occurs. In addition, it is started from the plan of each of the
    ``guessers``, and from ``random_guesses`` random guesses for each winding of the goal. An instance that no guess
    solves is tried a second time, from the same guesses and a straight line, and with the fallback solver where the
    primary one does not converge. Guesses depend on the seed and on p alone, so that a plan does not depend on its
    batch. :class:`~moe_policy.planners.repaired.Repaired` makes one solve from the plan of one planner instead, and
    keeps the plan where that fails.

    Args:
        problem: what to solve.
        database: source of warm starts: a Database, its samples or a NearestPlanner; ``None`` for none.
        guessers: planners whose plans are guesses, such as the experts of a mixture
            (:meth:`~moe_policy.planners.network.NetworkPlanner.expert_planners`); a plan that is not finite is none.
        neighbours: warm starts of each solution family.
        lookaround: number of nearest samples considered; by default the problem's own, :func:`lookaround_of`.
        random_guesses: random guesses for each winding; by default none where there are other guesses, else
            :data:`RANDOM_GUESSES`.
        seed: of the random guesses.
        solver: what solves; by default a new ``GuardedSolver(problem)``.
        name: short name for tables.

    Raises:
        TypeError: a database that is none, or a guesser that cannot be called.
        ValueError: a database or a guesser of another problem, or no guesses at all.
    """

    def __init__(
        self,
        problem: ProblemOrId,
        database: Samples | SampleSource | None = None,
        *,
        guessers: Sequence[Planner] = (),
        neighbours: int = 2,
        lookaround: int | None = None,
        random_guesses: int | None = None,
        seed: int = 0,
        solver: BatchSolver | None = None,
        name: str = "optimal",
    ) -> None:
        problem = problem_of(problem)
        check_kind("name", name, str)
        check_kind("solver", solver, (BatchSolver, NoneType))
        self.problem, self.name, self.seed, self.neighbours = problem, name, seed, neighbours
        self.lookaround = lookaround_of(problem) if lookaround is None else lookaround
        check_whole("lookaround", self.lookaround)
        self.guessers = _checked_guessers(problem, guessers)
        default = 0 if self.guessers or database is not None else RANDOM_GUESSES
        self.random_guesses = default if random_guesses is None else random_guesses
        for argument, value in {"neighbours": neighbours, "random_guesses": self.random_guesses, "seed": seed}.items():
            check_whole(argument, value, 0)
        self._nearest = _nearest(problem, database) if database is not None and neighbours > 0 else None
        if not (self.random_guesses or self.guessers or self._nearest):
            raise ValueError("no guesses: give a database with neighbours ≥ 1, guessers, or random_guesses ≥ 1")
        self.solver: BatchSolver = GuardedSolver(problem) if solver is None else solver

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,); NaN where no guess led to a verified solution."""
        return self.best(p)[0]

    def best(self, p: ArrayLike) -> tuple[Trajectory, Array]:
        """The cheapest verified solutions for ``p`` (B, np) or (np,), in its box or not, and their costs (B,); NaN and
        +inf where there is none. Where the initial state or the goal violates a constraint, nothing is solved.

        The angles of p may be written in any turn. Every instance is solved in the turn around the centre of the box,
        where the windings of the goal count from, and the solution is turned back.
        """
        within, turns = self.problem.in_one_turn(p)
        usual = [random_kind(self.problem)] * self.random_guesses
        feasible = np.ones(len(within), dtype=bool)
        feasible[list(infeasible_rows(self.problem, within))] = False
        trajectory, cost = _nothing(self.problem, len(within))
        for kinds, last_resort in ((usual, False), (["line", *usual], True)):
            due = feasible & ~np.isfinite(cost)
            if due.any():
                found, cost[due] = self._best(within[due], kinds, retry_with_fallback=last_resort)
                trajectory = trajectory.replaced(due, found)
        return trajectory.shifted(turns), cost

    def _best(self, p: Array, kinds: Sequence[GuessKind], retry_with_fallback: bool) -> tuple[Trajectory, Array]:
        """The best solution from warm starts and from a guess of each of ``kinds`` to each winding."""
        plans, cost = _nothing(self.problem, len(p))
        found = [*self._warm_starts(p), *self._predicted(p), *self._random_guesses(p, kinds)]
        attempts = _Attempts.concatenate(found) if found else None
        if not attempts:
            return plans, cost
        row, guess, winding = attempts.row, attempts.guess, attempts.winding
        solutions = self.solver.solve(p[row], guess, winding, retry_with_fallback=retry_with_fallback)
        # Sorted by row, then by cost: the first of every row is its best. A row of which no plan is finite has none.
        order = np.lexsort((solutions.cost, row))
        tried, first = np.unique(row[order], return_index=True)
        best = order[first]
        cost[tried] = solutions.cost[best]
        return plans.replaced(np.isin(np.arange(len(p)), tried), solutions.trajectory[best]), cost

    def _warm_starts(self, p: Array) -> Iterator[_Attempts]:
        if self._nearest is None:
            return
        around = self._nearest.neighbours(p, min(self.lookaround, len(self._nearest.parameters)))
        modes = self._nearest.mode[around]
        chosen = np.zeros(around.shape, dtype=bool)
        for mode in np.unique(modes):
            same = modes == mode
            chosen |= same & (np.cumsum(same, axis=1) <= self.neighbours)
        row, column = np.nonzero(chosen)
        yield _Attempts(row, self._nearest.trajectory[around[row, column]], np.full(len(row), NEAREST_WINDING))

    def _predicted(self, p: Array) -> Iterator[_Attempts]:
        """The finite plans of the guessers."""
        for planner in self.guessers if len(p) else ():
            plan = plans_of(planner, p)
            row = np.flatnonzero(plan.finite)
            yield _Attempts(row, plan[row], np.full(len(row), NEAREST_WINDING))

    def _random_guesses(self, p: Array, kinds: Sequence[GuessKind]) -> Iterator[_Attempts]:
        for row in range(len(p)) if kinds else ():
            # In single precision: an angle that was written in another turn differs by rounding errors.
            rng = np.random.default_rng((self.seed, *_whole(p[row] / self.problem.parameters.width)))
            for kind, group in itertools.groupby(kinds):
                winding = np.repeat(np.arange(len(self.problem.terminal)), len(list(group)))
                repeated = np.repeat(p[row : row + 1], len(winding), axis=0)
                guess = guesses(self.problem, repeated, winding, rng, kind)
                yield _Attempts(np.full(len(winding), row), guess, winding)


def _nothing(problem: OptimalControlProblem, count: int) -> tuple[Trajectory, Array]:
    """Plans and costs of ``count`` instances without a solution."""
    return problem.unflatten(np.full((count, problem.flat_size), np.nan)), np.full(count, np.inf)


def _checked_guessers(problem: OptimalControlProblem, guessers: Sequence[Planner]) -> tuple[Planner, ...]:
    """The ``guessers`` of ``problem``."""
    given = tuple(guessers) if isinstance(guessers, Iterable) else (None,)
    for planner in given:
        if not callable(planner):
            what = type(guessers if planner is None else planner).__name__
            raise TypeError(f"expected a sequence of planners as guessers, such as (planner,); got {what}")
        check_owner(problem, getattr(planner, "problem", None), "a guesser")
    return given


def _nearest(problem: OptimalControlProblem, database: Samples | SampleSource) -> NearestPlanner:
    """The stored solutions of ``problem`` in ``database``, nearest first."""
    if callable(database) and not hasattr(database, "samples"):
        raise TypeError(
            f"expected a Database, its samples or a NearestPlanner as database, got {type(database).__name__}; "
            "give a planner whose plans are guesses as guessers=(planner,), or take Repaired(planner) for one solve "
            "from its plan"
        )
    samples = samples_of(database)
    check_owner(problem, samples.problem, "the database")
    return NearestPlanner(samples)


def _whole(fractions: Array) -> list[int]:
    """``fractions`` (n,) of the parameter box in units of 1e-9, which rounding in another turn does not change."""
    return (np.round(fractions * 1e9).astype(np.int64).view(np.uint64)).tolist()
