"""On which side of the path constraints an optimal trajectory runs: the direction in which they push it.

With the multipliers λ_kj ≥ 0 of the constraints h_j(x_k, s) ≥ 0 at the knots k, the *reaction* of an optimum is

    r = Σ_k Σ_j λ_kj ∂h_j/∂x (x_k, s)

with states divided by their scales. Next to an obstacle it points away from it. Where the optimum swings from one side
of an obstacle to the other, its trajectory changes much and its reaction turns, while a network that learns both sides
predicts a trajectory between them, through the obstacle. Where no constraint is active, the gradient of the smallest
clearance takes the place of the reaction.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from moe_policy.planners.scaling import blocks
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.batch import BatchFunction, dense_function

#: Multipliers below this fraction of the largest of a trajectory, and largest ones below this value, are none.
_NEGLIGIBLE, _INACTIVE = 1e-6, 1e-6


def reactions(samples: Samples) -> Array:
    """The directions of the reactions of M ``samples``, unit vectors (M, nx).

    Raises:
        ValueError: a problem without path constraints, or samples whose multipliers are not known.
    """
    problem = samples.problem
    if not problem.n_clearances:
        raise ValueError(f"{problem.id} has no path constraints, expected some for 'reaction'; use another method")
    if not np.isfinite(samples.multipliers).all():
        raise ValueError("the multipliers of some samples are not known, expected those of a database")
    gradient, found = _gradients(problem), np.empty((len(samples), problem.system.nx))
    for rows in blocks(len(samples)):
        found[rows] = _sums(problem, gradient, samples[rows])
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.divide(found, length, out=np.zeros_like(found), where=length > 0)


def _gradients(problem: OptimalControlProblem) -> BatchFunction:
    """The function (x, s) → h (B, nh) and all ∂h_j/∂x · scale (B, nh · nx), one constraint after the other."""
    x, _, s = problem.symbols()
    clearances = problem.clearances(x, s)
    scaled = ca.jacobian(clearances, x) @ ca.diag(problem.system.state.scale)
    return BatchFunction(dense_function("clearance_gradients", [x, s], [clearances, ca.vec(scaled.T)]))


def _sums(problem: OptimalControlProblem, gradient: BatchFunction, samples: Samples) -> Array:
    """The reactions of B ``samples``, of any length, (B, nx)."""
    count, knots, nh = samples.multipliers.shape
    contexts = np.repeat(problem.start(samples.parameters)[1], knots, axis=0)
    clearance, gradients = gradient(samples.trajectory.states.reshape(count * knots, -1), contexts)
    weights = samples.multipliers.reshape(count, knots * nh)
    largest = weights.max(axis=1, keepdims=True)
    closest = np.arange(knots * nh) == clearance.reshape(count, -1).argmin(axis=1)[:, None]
    weights = np.where(largest > _INACTIVE, np.where(weights >= _NEGLIGIBLE * largest, weights, 0.0), closest)
    return np.asarray(np.einsum("bk,bkx->bx", weights, gradients.reshape(count, knots * nh, -1)))
