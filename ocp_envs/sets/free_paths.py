"""Optimal paths of a problem without its path constraint, on which the distribution of its obstacle is conditioned.

Parameters of a problem with an obstacle are drawn on condition that it blocks the optimal trajectory of the free
problem. Knots alone do not decide that, so the trajectory is made *dense*: it is the cubic Hermite interpolant of the
states x_k at the knots with the slopes h f(x_k, u_k), at ``POINTS`` points of every interval. (*Measured* for the
quadcopter: it deviates from the Runge-Kutta path of the plan by at most 3 mm, 0.15 mm in the median.)

Paths of other parameters are interpolated in a shipped table of solved ones with cubic radial basis functions over the
nearest (:class:`scipy.interpolate.RBFInterpolator`). A second interpolation, in every fourth path of the table, tells
how smooth the paths are there. The table carries two values measured on fresh paths: the largest error, and the largest
ratio of the error to the difference between the two interpolations. A clearance that is a distance changes by no more
than the path does, so these bounds tell where an interpolated path decides and where the solved one is needed.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from ocp_envs import tables
from ocp_envs.distribution import Blocked
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.packing import pack, unpack
from ocp_envs.system import Expression
from ocp_envs.trajectory import Trajectory

TABLE = "paths"
#: Points of the dense path in an interval.
POINTS = 16
#: Initial guesses of the duration of the free problem, tried in turn, as fractions of the longest.
_DURATIONS = (0.4, 0.6, 0.25, 0.8)
_NEIGHBOURS = 40


def blocked(problem: OptimalControlProblem) -> Blocked:
    """The distribution of ``problem``.

    Raises:
        ValueError: it is not conditioned on the free optimum being blocked.
    """
    if not isinstance(problem.distribution, Blocked):
        raise ValueError(
            f"{problem.id}: expected a problem with a free one and an obstacle that blocks its optimum, "
            f"distribution=Blocked(free, …); got {type(problem.distribution).__name__}"
        )
    return problem.distribution


@lru_cache(maxsize=32)
def coordinates(problem: OptimalControlProblem) -> tuple[int, ...]:
    """Indices of the m state coordinates that the path constraint of ``problem`` depends on."""
    x, _, s = problem.symbols()
    return tuple(np.flatnonzero(ca.which_depends(problem.clearances(x, s), x, 1, False)).tolist())


def spines(problem: OptimalControlProblem, trajectory: Trajectory) -> Array:
    """What dense paths are interpolated from: values, and slopes times h, at the knots, (B, N, 2, m).

    Args:
        problem: the problem with the path constraint, which depends on the m coordinates.
        trajectory: B trajectories of the free problem.
    """
    which, shape = list(coordinates(problem)), trajectory.states.shape
    controls = np.concatenate([trajectory.controls, trajectory.controls[:, -1:]], axis=1)
    x = trajectory.states.reshape(-1, shape[2])
    rate, _ = blocked(problem).free.functions.rate()(x, controls.reshape(len(x), -1), np.empty((len(x), 0)))
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
    state: list[Expression] = [0.0] * problem.system.nx
    for index, column in zip(coordinates(problem), points.T):
        state[index] = column[None]
    context = {name: values[:, None] for name, values in zip(problem.context.names, contexts.T)}
    replaced = {name: values for name, values in context.items() if name in problem.system.constants}
    constants = SimpleNamespace(**{**problem.system.constants, **replaced})
    values = problem.clearance(state, SimpleNamespace(**context), constants)
    return np.minimum.reduce([np.broadcast_to(value, (len(contexts), len(points))) for value in values])


def solve_free(problem: OptimalControlProblem, parameters: Array, solver: GuardedSolver) -> Trajectory:
    """Verified optimal trajectories of the free problem, each depending on its parameters alone.

    Args:
        problem: the problem with the path constraint.
        parameters: of the free problem, (B, np).
        solver: of the free problem.

    Raises:
        RuntimeError: none was found for one of them.
    """
    free = blocked(problem).free
    unsolved, flat = np.arange(len(parameters)), np.empty((len(parameters), free.flat_size))
    for fraction in _DURATIONS:
        windings = np.zeros(len(unsolved), np.int64)
        line = guesses(free, parameters[unsolved], windings, np.random.default_rng(0), "line")
        shortest, longest = free.horizon.of(free.start(parameters[unsolved])[1]).T
        line = dataclasses.replace(line, duration=np.maximum(fraction * longest, shortest))
        solutions = solver.solve(parameters[unsolved], line, windings)
        flat[unsolved] = solutions.trajectory.flat()
        unsolved = unsolved[~solutions.solved]
        if not len(unsolved):
            return free.unflatten(flat)
    raise RuntimeError(
        f"{free.id}: no optimal trajectory was found for {len(unsolved)} parameters, such as {parameters[unsolved[0]]}"
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
        interpolate = partial(RBFInterpolator, neighbors=min(_NEIGHBOURS, len(values) // 4), kernel="cubic", degree=2)
        return interpolate(places, values), interpolate(places[::4], values[::4])

    def __call__(self, parameters: Array) -> tuple[Array, Array]:
        """Dense paths (B, points, m) of parameters (B, np), and their distances from the second interpolation, (B,)."""
        shape = len(parameters), *self.spines.shape[1:]
        paths, others = (dense(np.reshape(spline(parameters / self.scale), shape)) for spline in self._splines)
        return paths, distance(paths, others)

    def tolerance(self, difference: Array) -> Array:
        """Bound of the distance from the solved path, (B,), given ``difference``, the second result of a call, (B,)."""
        return np.minimum(self.error, self.ratio * difference)


def measured(table: PathTable, parameters: Array, solved: Array) -> PathTable:
    """``table`` with its accuracy on fresh ``parameters`` (B, np) whose solved paths have the spines ``solved``."""
    paths, difference = table(parameters)
    errors = distance(paths, dense(solved))
    return dataclasses.replace(table, error=float(errors.max()), ratio=float((errors / difference).max()))


def distance(first: Array, second: Array) -> Array:
    """Largest distance between corresponding points of paths ``first`` and ``second`` (B, points, m), (B,)."""
    return np.asarray(np.linalg.norm(first - second, axis=2).max(axis=1))


@lru_cache(maxsize=8)
def shipped(problem: OptimalControlProblem) -> PathTable | None:
    """The table of the free problem in the package; ``None`` where there is none, or none is to be used."""
    distribution = blocked(problem)
    free = distribution.free
    if not distribution.tabulated or not tables.path_of(free, TABLE).is_file():
        return None
    arrays = tables.load(free, TABLE)
    names = [problem.system.state.names[i] for i in coordinates(problem)]
    if arrays["coordinates"].tolist() != names:
        return None
    parameters, unit, error, ratio = (
        np.asarray(arrays[key], dtype=np.float64) for key in ("parameters", "unit", "error", "ratio")
    )
    spines = _whole(arrays).reshape(len(parameters), -1, *unit.shape) * unit
    return PathTable(free.parameters.width, parameters, spines, float(error), float(ratio))


def _whole(arrays: dict[str, NDArray[np.generic]]) -> Ints:
    """What the spines in ``arrays`` of a file count in units; files that were made earlier hold it without packing."""
    return arrays["spines"].astype(np.int64) if "spines" in arrays else unpack(arrays["packed"].tobytes())


def _unit(spines: Array) -> Array:
    """What whole numbers of 16 bits count in the file: a small part of the largest of ``spines``, (2, m)."""
    return np.asarray(np.abs(spines).max(axis=(0, 1)) / np.iinfo(np.int16).max)


def as_stored(spines: Array) -> Array:
    """``spines`` (L, N, 2, m) as they come back from the file, changed by at most 1.6e-5 of the largest."""
    return np.asarray(np.rint(spines / _unit(spines)) * _unit(spines))


def ship(problem: OptimalControlProblem, table: PathTable) -> Path:
    """Write ``table`` into the package, as that of the free problem of ``problem``; the path of the file."""
    unit = _unit(table.spines)
    whole = np.rint(table.spines / unit).astype(np.int64).reshape(*table.spines.shape[:2], -1)
    names = [problem.system.state.names[i] for i in coordinates(problem)]
    return tables.save(
        blocked(problem).free,
        TABLE,
        parameters=table.parameters,
        packed=np.frombuffer(pack(whole), np.uint8),
        unit=unit,
        error=np.array(table.error),
        ratio=np.array(table.ratio),
        coordinates=np.array(names),
    )
