"""How far a problem instance is from a discontinuity of its optimal trajectory.

Where optimal trajectories fall into several families, the optimum is discontinuous where the two cheapest cost the
same. The distance is their relative cost difference

    (J_second − J_best) / |J_best|,

+inf where only one family is known.

Where a sphere blocks the optimal path of the free problem (the problem without its path constraint), the optimum is
discontinuous where that path runs through the centre: it may then pass on any side. The distance is that of the dense
free path x(t) from the centre c in radii, min ‖x(t) − c‖ / r: 0 at the discontinuity, 1 where the path touches the
sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ocp_envs.distribution import Blocked
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import free_paths
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array

#: Free paths in memory at once.
_BLOCK = 1_000


class Discontinuity(Protocol):
    """Where the optimum of a problem is discontinuous."""

    @property
    def label(self) -> str:
        """What the distance is, for the axis of a figure."""

    def distance(self, problem: OptimalControlProblem, p: Array, mode_costs: Array) -> Array:
        """Distances of instances from the discontinuity, (B,).

        Args:
            problem: the problem.
            p: parameters, (B, np).
            mode_costs: best known cost of every family, +inf where none is, (B, modes).
        """


@dataclass(frozen=True)
class EqualCosts:
    """The two cheapest families cost the same; ``label`` names the distance."""

    label: str = "(second best − best) / |best| cost of the solution families"

    def distance(self, problem: OptimalControlProblem, p: Array, mode_costs: Array) -> Array:
        return relative_cost_difference(mode_costs)


@dataclass(frozen=True)
class SphereCentre:
    """The free path runs through the centre of the sphere; ``label`` names the distance."""

    label: str = "distance of the free path from the centre, radii"

    def distance(self, problem: OptimalControlProblem, p: Array, mode_costs: Array) -> Array:
        return off_centre(problem, p)


def discontinuity_of(problem: OptimalControlProblem) -> Discontinuity | None:
    """Where the optimum of ``problem`` is discontinuous; ``None`` where nothing is known to make it so."""
    if isinstance(problem.distribution, Blocked) and problem.distribution.radius is not None:
        return SphereCentre()
    return EqualCosts() if len(problem.modes) > 1 else None


def relative_cost_difference(mode_costs: Array) -> Array:
    """(J_second − J_best) / |J_best| of the two cheapest families, (B,).

    Args:
        mode_costs: best known cost of every family, +inf where none is, (B, modes).

    Returns:
        the differences; +inf where fewer than two families are known, or the best cost is 0.
    """
    difference = np.full(len(mode_costs), np.inf)
    if mode_costs.shape[1] > 1:
        best, second = np.partition(mode_costs, 1, axis=1)[:, :2].T
        known = np.isfinite(second) & (best != 0)
        difference[known] = (second[known] - best[known]) / np.abs(best[known])
    return difference


def off_centre(problem: OptimalControlProblem, p: Array, solver: GuardedSolver | None = None) -> Array:
    """Distance of the free path from the centre of the sphere, in radii, (B,).

    Args:
        problem: one with the distribution :class:`~ocp_envs.distribution.Blocked` and a ``radius``.
        p: parameters, (B, np).
        solver: of the free problem, which is then solved. By default paths are interpolated in the shipped table (for
            the quadcopter they are off by at most 0.02 m), and solved where there is no table.

    Raises:
        ValueError: no such problem.
        RuntimeError: a free problem was not solved.
    """
    distribution = free_paths.blocked(problem)
    if distribution.radius is None:
        raise ValueError(f"{problem.id}: expected a problem with a sphere; its distribution names no radius")
    own = [problem.parameters.names.index(name) for name in distribution.free.parameters.names]
    contexts = problem.start(p)[1]
    smallest = np.empty(len(p))
    for begin in range(0, len(p), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        # One path and its own sphere at a time.
        pairs = zip(_paths(problem, p[rows, own], solver), contexts[rows])
        smallest[rows] = [free_paths.clearance_along(problem, path, s[None]).min() for path, s in pairs]
    return np.asarray(1 + smallest / contexts[:, problem.context.names.index(distribution.radius)])


def _paths(problem: OptimalControlProblem, parameters: Array, solver: GuardedSolver | None) -> Array:
    """Dense paths of the free problem: solved by ``solver``, else interpolated in the table if there is one."""
    table = free_paths.shipped(problem) if solver is None else None
    if table is not None:
        return table(parameters)[0]
    if solver is None:
        with GuardedSolver(free_paths.blocked(problem).free) as own:
            return _paths(problem, parameters, own)
    return free_paths.dense(free_paths.spines(problem, free_paths.solve_free(problem, parameters, solver)))
