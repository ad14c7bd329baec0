"""Optimal paths of a problem without its path constraint, on which parameters of the constrained problem are drawn.

Parameters of a problem with an obstacle are drawn on condition that the optimal trajectory of the free problem meets
it. That trajectory is wanted *dense*, not at its knots alone: it is the cubic Hermite interpolant of the knots' states
x_k with the slopes h f(x_k, u_k), at ``POINTS`` points of every interval (*measured* for the quadcopter: off the
Runge-Kutta path of the plan by 3 mm at most, 0.15 mm in the median).

Paths of other parameters are interpolated in a shipped table of solved ones (cubic radial basis functions over the
nearest, :class:`scipy.interpolate.RBFInterpolator`), and once more in every fourth of them, which tells how smooth the
paths are there. The table carries what was measured on fresh ones: the largest error, and the largest ratio of the
error to the difference between the two interpolations. A clearance that is a distance changes by no more than the path
does, so whoever decides by an interpolated path knows when to ask for the solved one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import RBFInterpolator

from ocp_envs import tables
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

TABLE = "paths"
#: Points of the dense path in an interval.
POINTS = 16
#: Shares of the longest duration from which the free problem is tried, one after another.
_DURATIONS = (0.4, 0.6, 0.25, 0.8)
_NEIGHBOURS = 40


@lru_cache(maxsize=32)
def coordinates(problem: OptimalControlProblem) -> tuple[int, ...]:
    """Indices of the m state coordinates that the path constraint depends on."""
    x, _, s = problem.symbols()
    return tuple(np.flatnonzero(ca.which_depends(problem.clearances(x, s), x, 1, False)).tolist())


def spines(problem: OptimalControlProblem, trajectory: Trajectory) -> Array:
    """What dense paths are made of: values and slopes times h at the knots, (B, N, 2, m).

    Args:
        problem: the problem with the path constraint, which names the m coordinates.
        trajectory: B trajectories of ``problem.free``.
    """
    assert problem.free is not None
    which, shape = list(coordinates(problem)), trajectory.states.shape
    controls = np.concatenate([trajectory.controls, trajectory.controls[:, -1:]], axis=1)
    x = trajectory.states.reshape(-1, shape[2])
    rate, _ = problem.free.batch_rate()(x, controls.reshape(len(x), -1), np.empty((len(x), 0)))
    slopes = rate.reshape(shape) * trajectory.step[:, None, None]
    return np.stack([trajectory.states[:, :, which], slopes[:, :, which]], axis=2)


@lru_cache(maxsize=8)
def _hermite(knots: int) -> Array:
    """Weights of values and slopes at the knots in every point of the dense path, (points, N, 2)."""
    position = np.arange((knots - 1) * POINTS + 1)
    left = np.minimum(position // POINTS, knots - 2)
    t = position / POINTS - left
    weights, rows = np.zeros((len(position), knots, 2)), np.arange(len(position))
    weights[rows, left] = np.stack([(1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2], axis=1)
    weights[rows, left + 1] = np.stack([t**2 * (3 - 2 * t), t**2 * (t - 1)], axis=1)
    return weights


def dense(spines: Array) -> Array:
    """Dense paths (B, points, m) of ``spines`` (B, N, 2, m)."""
    size, knots, _, m = spines.shape
    weights = _hermite(knots)
    return np.matmul(weights.reshape(len(weights), -1), spines.reshape(size, -1, m))


def clearance_along(problem: OptimalControlProblem, points: Array, contexts: Array) -> Array:
    """The smallest clearance of each context at each point, (K, points).

    Args:
        problem: the problem.
        points: the coordinates that the path constraint depends on, (points, m).
        contexts: (K, nc).
    """
    assert problem.clearance is not None
    state: list[Any] = [0.0] * problem.system.nx
    for index, column in zip(coordinates(problem), points.T):
        state[index] = column[None]
    context = {name: values[:, None] for name, values in zip(problem.context.names, contexts.T)}
    replaced = {name: values for name, values in context.items() if name in problem.system.constants}
    constants = SimpleNamespace(**{**problem.system.constants, **replaced})
    values: Sequence[Any] = problem.clearance(state, SimpleNamespace(**context), constants)
    return np.minimum.reduce([np.broadcast_to(value, (len(contexts), len(points))) for value in values])


def solve_free(problem: OptimalControlProblem, parameters: Array, solver: GuardedSolver) -> Trajectory:
    """Verified optimal trajectories of the free problem, each depending on its parameters alone.

    Args:
        problem: the problem with the path constraint.
        parameters: of ``problem.free``, (B, np).
        solver: of ``problem.free``.

    Raises:
        RuntimeError: none was found for one of them.
    """
    free = problem.free
    assert free is not None
    open_, found = np.arange(len(parameters)), None
    for share in _DURATIONS:
        windings = np.zeros(len(open_), np.int64)
        line = guesses(free, parameters[open_], windings, np.random.default_rng(0), "line")
        line = dataclasses.replace(line, duration=np.full(len(open_), share * free.duration[1]))
        solutions = solver.solve(parameters[open_], line, windings)
        if found is None:
            found = solutions.trajectory
        else:
            for ours, theirs in zip(vars(found).values(), vars(solutions.trajectory).values()):
                ours[open_] = theirs
        open_ = open_[~solutions.solved]
        if not len(open_):
            return found
    raise RuntimeError(
        f"{free.id}: no optimal trajectory was found for {len(open_)} parameters, {parameters[open_[0]]}"
    )


@dataclass(frozen=True, eq=False)
class PathTable:
    """Solved paths of the free problem.

    Args:
        scale: width of the box of the free problem's parameters, (np,).
        parameters: of the free problem, (L, np).
        spines: (L, N, 2, m).
        error: the largest distance between the dense paths interpolated and solved that was measured, in the unit of
            the coordinates.
        ratio: the largest ratio of that distance to the one between the dense paths interpolated in all and in every
            fourth.
    """

    scale: Array
    parameters: Array
    spines: Array
    error: float = np.inf
    ratio: float = np.inf

    @cached_property
    def _splines(self) -> tuple[RBFInterpolator, RBFInterpolator]:
        """In all paths and in every fourth."""
        values, places = self.spines.reshape(len(self.spines), -1), self.parameters / self.scale
        how: dict[str, Any] = {"neighbors": min(_NEIGHBOURS, len(values) // 4), "kernel": "cubic", "degree": 2}
        return RBFInterpolator(places, values, **how), RBFInterpolator(places[::4], values[::4], **how)

    def __call__(self, parameters: Array) -> tuple[Array, Array]:
        """Dense paths (B, points, m) of ``parameters`` (B, np), and how far each is interpolated otherwise, (B,)."""
        shape = len(parameters), *self.spines.shape[1:]
        paths, others = (dense(np.reshape(spline(parameters / self.scale), shape)) for spline in self._splines)
        return paths, distance(paths, others)

    def tolerance(self, difference: Array) -> Array:
        """How far a path may be off the solved one, (B,), given the second result of a call."""
        return np.minimum(self.error, self.ratio * difference)


def measured(table: PathTable, parameters: Array, solved: Array) -> PathTable:
    """``table`` with its accuracy on fresh ``parameters`` (B, np) whose solved paths have the spines ``solved``."""
    paths, difference = table(parameters)
    errors = distance(paths, dense(solved))
    return dataclasses.replace(table, error=float(errors.max()), ratio=float((errors / difference).max()))


def distance(first: Array, second: Array) -> Array:
    """Largest distance between points of paths (B, points, m) that belong together, (B,)."""
    return np.asarray(np.linalg.norm(first - second, axis=2).max(axis=1))


def width(free: OptimalControlProblem) -> Array:
    """Width of the parameter box."""
    return free.parameters.width


@lru_cache(maxsize=8)
def shipped(problem: OptimalControlProblem) -> PathTable | None:
    """The table of ``problem.free`` in the package; ``None`` where there is none."""
    free = problem.free
    assert free is not None
    if not tables.path_of(free, TABLE).is_file():
        return None
    arrays: dict[str, Any] = tables.load(free, TABLE)
    names = [problem.system.state.names[i] for i in coordinates(problem)]
    if arrays["coordinates"].tolist() != names:
        return None
    spines = np.asarray(arrays["spines"], dtype=np.float64)
    return PathTable(width(free), arrays["parameters"], spines, float(arrays["error"]), float(arrays["ratio"]))


def ship(problem: OptimalControlProblem, table: PathTable) -> Any:
    """Write ``table`` into the package; the file's path."""
    assert problem.free is not None
    names = [problem.system.state.names[i] for i in coordinates(problem)]
    return tables.save(
        problem.free,
        TABLE,
        parameters=table.parameters,
        spines=table.spines.astype(np.float32),
        error=np.array(table.error),
        ratio=np.array(table.ratio),
        coordinates=np.array(names),
    )
