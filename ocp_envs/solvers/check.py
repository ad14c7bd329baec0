"""The independent check of a solution, which uses ``problem.flow`` but neither the solver nor its program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.trajectory import Trajectory

DEFECT_TOLERANCE = 1e-6
#: Sum of the transcription's box around the goal (1e-5) and the solver's tolerance.
GOAL_TOLERANCE = 2e-5
BOUND_TOLERANCE = 1e-6
COST_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Check:
    """Results of the check of B trajectories, each (B,); NaN where a trajectory is not finite.

    Maxima of ``defect``, ``goal`` and ``bounds`` in scaled units and of ``path`` in the unit of the constraint, the
    recomputed ``cost``, and whether all are within tolerance, ``passed``.
    """

    defect: Array  #: error of the initial state and of x_{k+1} − F(x_k, u_k)
    goal: Array  #: distance of a final coordinate from the goal, modulo whole turns
    bounds: Array  #: excess over a bound of state, control or duration
    path: Array  #: violation of the path constraint at the knots
    cost: Array
    passed: Bools


def verify(
    problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, cost: Array | None = None
) -> Check:
    """Check B trajectories ``trajectory`` against the instances of ``problem`` with ``parameters`` (B, np).

    The claimed costs ``cost`` (B,), if given, are compared with the recomputed ones.
    """
    size, knots, nx = trajectory.states.shape
    initial, contexts = problem.start(parameters)
    system, state_scale = problem.system, problem.system.state.scale
    context = np.repeat(contexts, knots - 1, axis=0)
    following, costs = problem.batch_flow(problem.substeps)(
        trajectory.states[:, :-1].reshape(-1, nx),
        trajectory.controls.reshape(-1, system.nu),
        context,
        np.repeat(trajectory.step, knots - 1)[:, None],
    )
    defects = (trajectory.states[:, 1:] - following.reshape(size, knots - 1, nx)) / state_scale
    total = costs.reshape(size, knots - 1).sum(axis=1)
    start_error = (trajectory.states[:, 0] - initial) / state_scale
    defect = np.maximum(np.abs(defects).max(axis=(1, 2)), np.abs(start_error).max(axis=1))
    goal = np.abs(system.difference(trajectory.states[:, -1], problem.goal.state) / state_scale).max(axis=1)
    bounds = _excess(problem, trajectory)
    path = path_violation(problem, trajectory, contexts)
    passed = (defect <= DEFECT_TOLERANCE) & (goal <= GOAL_TOLERANCE)
    passed &= (bounds <= BOUND_TOLERANCE) & (path <= BOUND_TOLERANCE) & np.isfinite(total)
    if cost is not None:
        passed &= np.abs(total - cost) <= COST_TOLERANCE * (1 + np.abs(total))
    return Check(defect, goal, bounds, path, total, passed)


def _excess(problem: OptimalControlProblem, trajectory: Trajectory) -> Array:
    pairs = [(trajectory.states, problem.system.state), (trajectory.controls, problem.system.control)]
    excess = [np.maximum(box.lower - v, v - box.upper) / box.scale for v, box in pairs]
    shortest, longest = problem.duration
    duration = np.maximum(shortest - trajectory.duration, trajectory.duration - longest) / longest
    largest = np.maximum(*[e.max(axis=(1, 2)) for e in excess])
    return np.asarray(np.maximum(np.maximum(largest, duration), 0.0))


def path_violation(problem: OptimalControlProblem, trajectory: Trajectory, contexts: Array) -> Array:
    """Maximum violation of the path constraints of ``problem`` at the knots, (B,), in the clearances' unit.

    0 without constraints; NaN for a ``trajectory`` that is not finite. The instances have ``contexts`` (B, nc).
    """
    if not problem.n_clearances:
        return np.zeros(len(trajectory))
    size, knots, nx = trajectory.states.shape
    (clearance,) = problem.batch_clearances()(trajectory.states.reshape(-1, nx), np.repeat(contexts, knots, axis=0))
    return np.asarray(np.maximum(-clearance.reshape(size, knots * problem.n_clearances).min(axis=1), 0.0))
