"""Parameters of problem instances: a random sample, or a grid.

A sample follows the distribution that the problem declares (:mod:`ocp_envs.distribution`). Where that is conditioned on
the free optimum being blocked, each row takes three steps. The parameters of the free problem are drawn uniformly, its
optimal path is found, and the other parameters are drawn uniformly until initial state and goal are clear and the path
is not. Most draws are decided by a path interpolated in the shipped table (:mod:`ocp_envs.sets.free_paths`). A row with
a draw closer to the decision than the table is accurate is drawn again from its first random number with the solved
path, so the sample is the one that solved paths would give.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, singledispatch

import cloudpickle
import numpy as np

from ocp_envs.distribution import Blocked, Distribution, Uniform
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.sets import free_paths
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import track

#: Rows of a task.
_CHUNK = 2_000
#: Number of draws at once for one row, the first time; doubled each time after that, up to the maximum.
_FIRST_DRAWS, _MOST_DRAWS = 64, 4096
#: Draws after which a row is given up.
_PATIENCE = 10**7
#: Parameters of one sample.
_MOST = 10**8


@checked
def sample(problem: ProblemOrId, seed: int, n: int, *, workers: int | None = 1) -> Array:
    """``n`` parameters drawn from the distribution of ``problem``, (n, np); the i-th depends on the seed and i alone.

    Args:
        problem: the problem.
        seed: of the draw, at least 0.
        n: number of parameters, at most 10⁸.
        workers: number of processes, where drawing needs solutions; ``None`` for one per core.

    Raises:
        ValueError: a negative seed or number.
        RuntimeError: the free problem was not solved, or no draw blocks its path.
    """
    problem = problem_of(problem)
    check_whole("n", n, 0, _MOST)
    return _sample(problem.distribution, problem, seed, n, workers)


@singledispatch
def _sample(
    distribution: Distribution, problem: OptimalControlProblem, seed: int, n: int, workers: int | None
) -> Array:
    parts = [
        distribution.draw(problem, [_stream(seed, row) for row in range(begin, min(begin + _CHUNK, n))])
        for begin in range(0, n, _CHUNK)
    ]
    return np.concatenate([*parts, np.empty((0, len(problem.parameters)))])


def _stream(seed: int, row: int) -> np.random.Generator:
    """Random numbers of one ``row`` of a sample."""
    return np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, row + 1]))


@_sample.register
def _(distribution: Uniform, problem: OptimalControlProblem, seed: int, n: int, workers: int | None) -> Array:
    # Philox is counter-based: the rows of a longer draw begin with those of a shorter one.
    return problem.parameters.draw(np.random.Generator(np.random.Philox(key=seed)), n)


@_sample.register
def _(distribution: Blocked, problem: OptimalControlProblem, seed: int, n: int, workers: int | None) -> Array:
    bounds = [(begin, min(begin + _CHUNK, n)) for begin in range(0, n, _CHUNK)]
    count = min(workers or os.cpu_count() or 1, len(bounds))
    if count <= 1:
        with BlockedDraws(problem, seed) as draw:
            parts = [draw(begin, end) for begin, end in bounds]
    else:
        payload = cloudpickle.dumps(problem)
        with WorkerPool(count) as pool:
            futures = [pool.submit(_draw, payload, seed, *rows) for rows in bounds]
            shown = track(futures, len(futures), unit="block", label=f"draws of {problem.id}", leave=False)
            parts = [future.result() for future in shown]
    return np.concatenate([*parts, np.empty((0, len(problem.parameters)))])


def _draw(payload: bytes, seed: int, begin: int, end: int) -> Array:
    with BlockedDraws(cloudpickle.loads(payload), seed) as draw:
        return draw(begin, end)


@dataclass(frozen=True, eq=False)
class BlockedDraws:
    """Draws conditioned on the free optimum being blocked; owns a solver of the free problem once it needs one.

    Args:
        problem: one with the distribution :class:`~ocp_envs.distribution.Blocked`.
        seed: of the draw.

    Raises:
        ValueError: another distribution.
    """

    problem: OptimalControlProblem
    seed: int

    def __post_init__(self) -> None:
        free_paths.blocked(self.problem)

    @cached_property
    def _free(self) -> OptimalControlProblem:
        return free_paths.blocked(self.problem).free

    @cached_property
    def _solver(self) -> GuardedSolver:
        return GuardedSolver(self._free)

    def __enter__(self) -> BlockedDraws:
        return self

    def __exit__(self, *exception: object) -> None:
        if "_solver" in vars(self):
            self._solver.close()

    @cached_property
    def _columns(self) -> tuple[list[int], list[int]]:
        """Columns of p that are parameters of the free problem, in its order, and the others."""
        names = self.problem.parameters.names
        own = [names.index(name) for name in self._free.parameters.names]
        return own, [i for i in range(len(names)) if i not in own]

    def _stream(self, row: int) -> np.random.Generator:
        return _stream(self.seed, row)

    def __call__(self, begin: int, end: int) -> Array:
        """Rows ``begin`` … ``end`` of the sample, (end − begin, np).

        Raises:
            RuntimeError: the free problem was not solved, or no draw blocks its path.
        """
        rows, (own, _) = np.arange(begin, end), self._columns
        box, table = self.problem.parameters, free_paths.shipped(self.problem)
        unit = np.array([self._stream(row).random(len(own)) for row in rows.tolist()])
        free = box.lower[own] + unit * box.width[own]
        p, unsure = np.empty((len(rows), len(box))), np.ones(len(rows), bool)
        if table is not None:
            paths, difference = table(free)
            unsure = ~self._accept(p, np.arange(len(rows)), rows, free, paths, table.tolerance(difference))
        at = np.flatnonzero(unsure)
        if len(at):
            solved = free_paths.solve_free(self.problem, free[at], self._solver)
            paths = free_paths.dense(free_paths.spines(self.problem, solved))
            self._accept(p, at, rows[at], free[at], paths, np.zeros(len(at)))
        return p

    def _accept(self, p: Array, at: Ints, rows: Ints, free: Array, paths: Array, tolerance: Array) -> Bools:
        """Write accepted draws into ``p[at]``; whether every decision was further than ``tolerance`` from 0."""
        sure = np.ones(len(at), bool)
        for i, (place, row) in enumerate(zip(at.tolist(), rows.tolist())):
            found = self._first(row, free[i], paths[i], tolerance[i])
            sure[i] = found is not None
            if found is not None:
                p[place] = found
        return sure

    def _first(self, row: int, free: Array, path: Array, tolerance: float) -> Array | None:
        """The first draw of a row that is accepted; ``None`` if one before it is too close to call."""
        problem, (own, others) = self.problem, self._columns
        lower, width = problem.parameters.lower[others], problem.parameters.width[others]
        stream, drawn, count = self._stream(row), 0, _FIRST_DRAWS
        stream.random(len(own))  # those of the free problem
        ends = self._ends(free)
        while drawn < _PATIENCE:
            draws = lower + stream.random((count, len(others))) * width
            p = np.empty((count, len(problem.parameters)))
            p[:, own], p[:, others] = free, draws
            contexts = problem.start(p)[1]
            clear = np.flatnonzero((free_paths.clearance_along(problem, ends, contexts) > 0).all(axis=1))
            smallest = free_paths.clearance_along(problem, path, contexts[clear]).min(axis=1)
            met = np.flatnonzero(smallest < tolerance)
            if len(met):
                return None if smallest[met[0]] > -tolerance else p[clear[met[0]]]
            drawn += count
            count = min(2 * count, _MOST_DRAWS)
        raise RuntimeError(
            f"{problem.id}: none of {drawn} draws blocks the optimal path of the free problem from {free}"
        )

    def _ends(self, free: Array) -> Array:
        """Initial state and goal in the coordinates of the path constraint, (2, m)."""
        start, _ = self._free.start(free[None])
        return np.concatenate([start, self.problem.goal.state[None]])[:, list(free_paths.coordinates(self.problem))]


@checked
def grid(problem: ProblemOrId, shape: Sequence[int]) -> Array:
    """The uniform grid over the parameter box with both ends, (prod(shape), np); the last coordinate varies fastest.

    Args:
        problem: the problem.
        shape: number of points along each coordinate of p, at least 2 each.

    Raises:
        ValueError: another number of coordinates, or fewer than 2 points along one.
    """
    problem = problem_of(problem)
    box = problem.parameters
    if len(shape) != len(box) or min(shape) < 2:
        raise ValueError(f"{problem.id}: expected {len(box)} numbers of points ≥ 2, got {tuple(shape)}")
    axes = [np.linspace(low, high, count) for low, high, count in zip(box.lower, box.upper, shape)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(box))
