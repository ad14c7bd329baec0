"""How far a problem lies from the jump of its optimal trajectory.

Where the optimum is one of several modes, it jumps where the best two cost the same. The distance is the *gap*

    (J_second − J_best) / J_best

between the best costs of the two cheapest modes, +inf where one mode alone is known.

Where a sphere stands in the way of the optimal path of the free problem (the one without the path constraint), the
optimum jumps where that path runs through the centre: it may then pass on any side. The distance is that of the dense
free path from the centre in radii, min ‖x(t) − c‖ / r: 0 at the jump, 1 where the path only touches the sphere.
"""

from __future__ import annotations

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import free_paths
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array

#: The context coordinate that holds the radius of a sphere; the clearance is the distance from its centre less that.
RADIUS = "radius"
#: Free paths in memory at once.
_BLOCK = 1_000


def has_jump(problem: OptimalControlProblem) -> bool:
    """Whether the optimum jumps: there are several modes, or a sphere in the way."""
    return problem.free is not None or len(problem.modes) > 1


def relative_cost_difference(mode_costs: Array) -> Array:
    """(J_second − J_best) / |J_best| of the two cheapest families, (B,).

    Args:
        mode_costs: best known cost of every family, +inf where none is, (B, modes).

    Returns:
        the differences; +inf where no two families are known, or the best costs nothing.
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
        problem: one with a sphere: free where its path constraint is left out, with a context coordinate ``radius``.
        p: parameters, (B, np).
        solver: of the free problem, which then is solved; by default paths are interpolated in the shipped table where
            there is one (for the quadcopter they are off by 0.02 m at most).

    Raises:
        ValueError: no such problem.
        RuntimeError: a free problem was not solved.
    """
    free = problem.free
    if free is None or RADIUS not in problem.context.names:
        raise ValueError(
            f"{problem.id}: expected a problem with a sphere in the way of a free one, its radius in the context "
            f"coordinate {RADIUS!r}; got context {list(problem.context.names)}"
        )
    own = [problem.parameters.names.index(name) for name in free.parameters.names]
    table = free_paths.shipped(problem) if solver is None else None
    contexts = problem.start(p)[1]
    least = np.empty(len(p))
    for begin in range(0, len(p), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        if table is not None:
            paths, _ = table(p[rows, own])
        else:
            paths = _solved(problem, p[rows, own], solver)
        # One path and its own sphere at a time.
        pairs = zip(paths, contexts[rows])
        least[rows] = [free_paths.clearance_along(problem, path, s[None]).min() for path, s in pairs]
    return np.asarray(1 + least / contexts[:, problem.context.names.index(RADIUS)])


def _solved(problem: OptimalControlProblem, parameters: Array, solver: GuardedSolver | None) -> Array:
    """Dense paths of the free problem, solved."""
    assert problem.free is not None
    if solver is None:
        with GuardedSolver(problem.free) as own:
            return _solved(problem, parameters, own)
    return free_paths.dense(free_paths.spines(problem, free_paths.solve_free(problem, parameters, solver)))


def distance_to_jump(problem: OptimalControlProblem, p: Array, mode_costs: Array) -> Array:
    """The distance that the module describes, (B,): off the centre where there is a sphere, else the gap.

    Args:
        problem: the problem.
        p: parameters, (B, np).
        mode_costs: best known cost of every mode, (B, modes).
    """
    return off_centre(problem, p) if problem.free is not None else relative_cost_difference(mode_costs)
