"""Which problems a figure in space shows: a start that rises past a sphere, where the optimum flips, who enters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.planners.scaling import Standardizer
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import path_violation
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory


def flip_parameters(
    problem: OptimalControlProblem,
    centre: ArrayLike,
    radius: float,
    start_xy: ArrayLike,
    z_low: float,
    z_high: float,
    count: int,
) -> Array:
    """Parameters (count, np) along which the start rises past a sphere that stands still.

    Args:
        problem: one with the parameters x, y, z, cx, cy, cz, radius.
        centre: of the sphere, (3,), metres.
        radius: of the sphere, metres.
        start_xy: where the starts are, (2,), metres.
        z_low: height of the first start, metres.
        z_high: height of the last one.
        count: number of starts, at equal distances, at least two.

    Raises:
        ValueError: other parameters, wrong shapes, fewer than two starts, values outside the box, or a start inside
            the sphere.
    """
    names = ("x", "y", "z", "cx", "cy", "cz", "radius")
    if problem.parameters.names != names:
        raise ValueError(f"{problem.id}: expected the parameters {names}, got {problem.parameters.names}")
    if np.shape(centre) != (3,) or np.shape(start_xy) != (2,) or count < 2:
        got = f"{np.shape(centre)}, {np.shape(start_xy)} and {count}"
        raise ValueError(f"expected centre (3,), start_xy (2,) and a count of at least 2, got {got}")
    p = np.empty((count, 7))
    p[:, :2], p[:, 3:6], p[:, 6] = start_xy, centre, radius
    p[:, 2] = np.linspace(z_low, z_high, count)
    p = problem.check_parameters(p)
    inside = np.linalg.norm(p[:, :3] - p[:, 3:6], axis=1) < radius
    if inside.any():
        raise ValueError(f"starts at z = {p[inside, 2].tolist()} lie inside the sphere; choose another start_xy")
    return p


def find_flip(optimal: Trajectory) -> int:
    """The index i after which a sequence of optimal trajectories jumps: the largest step is from i to i + 1.

    Steps are Euclidean distances of flat trajectories, every component standardised over the sequence; of equal ones
    the first counts.

    Args:
        optimal: K trajectories along a path of parameters.

    Raises:
        ValueError: fewer than two trajectories, or one that is not finite.
    """
    if len(optimal) < 2:
        raise ValueError(f"expected at least two trajectories, got {len(optimal)}")
    flat = optimal.flat()
    steps = np.diff(Standardizer.fit(flat).scale(flat), axis=0)
    return int(np.linalg.norm(steps, axis=1).argmax())


def plan_violations(problem: OptimalControlProblem, parameters: ArrayLike, plans: Trajectory) -> Array:
    """The worst violation of the path constraints at the knots of each plan, (B,), at least 0; metres for a sphere.

    Args:
        problem: one with path constraints.
        parameters: (B, np).
        plans: B plans; one that is not finite gives NaN.

    Raises:
        ValueError: no path constraints, or shapes that do not fit.
    """
    if not problem.n_clearances:
        raise ValueError(f"{problem.id} has no path constraints that a plan could violate")
    p = problem.check_parameters(parameters, extrapolate=True)
    if len(plans) != len(p) or plans.states.shape[2] != problem.system.nx:
        raise ValueError(
            f"{problem.id}: expected {len(p)} plans of {problem.system.nx} states, one for each parameter, "
            f"got states of shape {plans.states.shape}"
        )
    return np.where(plans.finite, path_violation(problem, plans, problem.start(p)[1]), np.nan)
