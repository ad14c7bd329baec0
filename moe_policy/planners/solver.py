"""The nonlinear program as a planner: solved from several guesses, the cheapest verified solution is the plan."""

from __future__ import annotations

import itertools
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy import store
from moe_policy.planners.nearest import NearestPlanner
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING, GuessKind, guesses, random_kind
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory


class BatchSolver(Protocol):
    """What solves a batch of problems from one guess each; as ``GuardedSolver`` of ``ocp_envs`` does."""

    def solve(
        self, parameters: Array, guesses: Trajectory, windings: NDArray[np.integer], *, retry_with_fallback: bool = True
    ) -> Solutions:
        """As :meth:`ocp_envs.solvers.solver.GuardedSolver.solve`."""


class SolverPlanner:
    """Plans by solving the nonlinear program.

    Every p is started from its nearest samples in ``database``: among ``lookaround`` of them, the ``neighbours``
    nearest of every mode that occurs there. Beside that, or without a database, each winding of the goal is started
    from ``starts`` random guesses. What no guess solves is tried once more, from these guesses and a straight line, and
    with the fallback solver where that does not converge.
    The guesses depend on the seed and on p alone, so a plan does not depend on the batch it is made in.

    Args:
        problem: what to solve.
        database: source of warm starts, a Database, its samples or a NearestPlanner; without it random guesses must do.
        neighbours: warm starts for each mode.
        lookaround: nearest samples among which modes are looked for.
        starts: random guesses for each winding; by default none beside warm starts, else 8.
        seed: of the random guesses.
        solver: what solves; by default a new ``GuardedSolver(problem)``.
        name: short name for tables.

    Raises:
        ValueError: a database of another problem, or no guesses at all.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        database: Samples | SampleSource | None = None,
        *,
        neighbours: int = 2,
        lookaround: int = 12,
        starts: int | None = None,
        seed: int = 0,
        solver: BatchSolver | None = None,
        name: str = "optimal",
    ) -> None:
        self.problem, self.name, self.seed = problem, name, seed
        self.neighbours, self.lookaround = neighbours, lookaround
        self.starts = (8 if database is None else 0) if starts is None else starts
        self._nearest: NearestPlanner | None = None
        if database is not None and neighbours > 0:
            samples = samples_of(database)
            if samples.problem.id != problem.id:
                raise ValueError(f"the database belongs to {samples.problem.id}, not to {problem.id}")
            self._nearest = NearestPlanner(samples)
        if self.starts < 0 or (self.starts == 0 and self._nearest is None):
            raise ValueError("no guesses: give a database with neighbours ≥ 1, or starts ≥ 1")
        self.solver: BatchSolver = GuardedSolver(problem) if solver is None else solver

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters (B, np) or (np,); NaN where no guess led to a verified solution."""
        return self.best(p)[0]

    def best(self, p: ArrayLike) -> tuple[Trajectory, Array]:
        """The cheapest verified solution of B parameters, and its cost (B,); NaN and +inf where there is none."""
        checked = self.problem.check_parameters(p, extrapolate=True)
        usual = [random_kind(self.problem)] * self.starts
        trajectory, cost = self._best(checked, usual, retry_with_fallback=False)
        lost = np.flatnonzero(~np.isfinite(cost))
        if not len(lost):
            return trajectory, cost
        again, cost[lost] = self._best(checked[lost], ["line", *usual], retry_with_fallback=True)
        merged = trajectory.flat()
        merged[lost] = again.flat()
        return self.problem.unflatten(merged), cost

    def _best(self, checked: Array, kinds: list[GuessKind], retry_with_fallback: bool) -> tuple[Trajectory, Array]:
        rows, guess, windings = self._guesses(checked, kinds)
        if not len(rows):
            return guess, np.empty(0)
        solutions = self.solver.solve(checked[rows], guess, windings, retry_with_fallback=retry_with_fallback)
        # Sorted by row, then by cost: the first of every row is its best.
        order = np.lexsort((solutions.cost, rows))
        best = order[np.searchsorted(rows[order], np.arange(len(checked)))]
        return solutions.trajectory[best], solutions.cost[best]

    def _guesses(self, p: Array, kinds: list[GuessKind]) -> tuple[NDArray[np.int64], Trajectory, NDArray[np.int64]]:
        """Row of p, guess and winding of every solve: warm starts, and a guess of each of ``kinds`` to each winding."""
        every = np.arange(len(p))
        rows, parts, windings = [], [], []
        if self._nearest is not None and len(p):
            owner, sample = self._warm_starts(self._nearest, p)
            rows.append(owner)
            parts.append(self._nearest.trajectory[sample])
            windings.append(np.full(len(owner), NEAREST_WINDING))
        for row in every if kinds else ():
            rng = np.random.default_rng((self.seed, *p[row].view(np.uint64).tolist()))
            for kind, group in itertools.groupby(kinds):
                each = np.repeat(np.arange(len(self.problem.targets)), len(list(group)))
                repeated = np.repeat(p[row : row + 1], len(each), axis=0)
                parts.append(guesses(self.problem, repeated, each, rng, kind))
                rows.append(np.full(len(each), row))
                windings.append(each)
        if not parts:
            system, knots = self.problem.system, self.problem.knots
            parts = [Trajectory(np.empty((0, knots, system.nx)), np.empty((0, knots - 1, system.nu)), np.empty(0))]
            return every, parts[0], every
        return np.concatenate(rows), Trajectory.concatenate(parts), np.concatenate(windings)

    def _warm_starts(self, nearest: NearestPlanner, p: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row of p and number of the sample of every warm start."""
        around = nearest.neighbours(p, min(self.lookaround, len(nearest.parameters)))
        modes = nearest.mode[around]
        chosen = np.zeros(around.shape, dtype=bool)
        for mode in np.unique(modes):
            same = modes == mode
            chosen |= same & (np.cumsum(same, axis=1) <= self.neighbours)
        row, column = np.nonzero(chosen)
        return row, around[row, column]


def with_shipped_samples(problem: OptimalControlProblem) -> SolverPlanner:
    """The solver, warm-started from the shipped samples of the problem where there are any."""
    database = store.load(problem.id, "nearest") if "nearest" in store.available(problem.id) else None
    return SolverPlanner(problem, database)
