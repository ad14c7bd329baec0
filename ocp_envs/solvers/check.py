"""The independent check of a solution, which uses ``problem.flow`` but neither the solver nor its program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.system import Box
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
    path: Array  #: violation of the constraints on path and end, at the knots
    cost: Array
    passed: Bools


def verify(
    problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, cost: Array | None = None
) -> Check:
    """Check B trajectories ``trajectory`` against the instances of ``problem`` with ``parameters`` (B, np).

    The claimed costs ``cost`` (B,), if given, are compared with the recomputed ones.
    """
    found, total = residuals(problem, parameters, trajectory)
    largest = {name: amount.max(axis=(1, 2), initial=0.0) for name, amount in found.items()}
    defect, goal = largest["dynamics"], largest["goal"]
    path = np.max([largest[name] for name in ("clearance", "between", "mixed", "final")], axis=0)
    bounds = np.maximum(np.maximum(largest["state"], largest["control"]), largest["duration"])
    passed = (defect <= DEFECT_TOLERANCE) & (goal <= GOAL_TOLERANCE)
    passed &= (bounds <= BOUND_TOLERANCE) & (path <= BOUND_TOLERANCE) & np.isfinite(total)
    if cost is not None:
        passed &= np.abs(total - cost) <= COST_TOLERANCE * (1 + np.abs(total))
    return Check(defect, goal, bounds, path, total, passed)


def residuals(
    problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory
) -> tuple[dict[str, Array], Array]:
    """By how much B trajectories ``trajectory`` violate each constraint, at least 0, and their costs (B,).

    They belong to instances of ``problem`` with ``parameters`` (B, np). Violations have the shape (B, knots,
    components), in scaled units (those of the duration as a fraction of the longest one) or in the unit of the
    constraint. "dynamics", "state" and "clearance" have all knots, the initial condition being part of "dynamics",
    "control", "between" and "mixed" all but the last, and "goal", "final" (the last) and "duration" one.
    """
    size, knots, nx = trajectory.states.shape
    initial, contexts = problem.start(parameters)
    system, states, controls = problem.system, trajectory.states, trajectory.controls
    following, costs = problem.functions.flow(problem.substeps)(
        states[:, :-1].reshape(-1, nx),
        controls.reshape(-1, system.nu),
        np.repeat(contexts, knots - 1, axis=0),
        np.repeat(trajectory.step, knots - 1)[:, None],
    )
    expected = np.concatenate([initial[:, None], following.reshape(size, knots - 1, nx)], axis=1)
    shortest, longest = problem.horizon.of(contexts).T
    duration = np.maximum(shortest - trajectory.duration, trajectory.duration - longest) / longest
    last = states[:, -1]
    found = {
        "dynamics": np.abs((states - expected) / system.state.scale),
        "goal": (problem.terminal.distances(last, contexts) / system.state.scale)[:, None],
        "state": _excess(states, problem.planned_states),
        "control": _excess(controls, problem.planned_controls),
        "duration": np.maximum(duration, 0.0)[:, None, None],
        "clearance": _shortfall(problem, trajectory, contexts),
        "between": _between(problem, trajectory, contexts),
        "mixed": _mixed(problem, trajectory, contexts),
        "final": problem.terminal.violations(last, contexts)[:, None],
    }
    total = costs.reshape(size, knots - 1).sum(axis=1)
    if problem.terminal_cost is not None:
        total = total + problem.functions.terminal_cost()(last, contexts)[0][:, 0]
    return found, total


def _excess(values: Array, box: Box) -> Array:
    return np.asarray(np.maximum(np.maximum(box.lower - values, values - box.upper) / box.scale, 0.0))


def _between(problem: OptimalControlProblem, trajectory: Trajectory, contexts: Array) -> Array:
    """How far clearances are below 0 inside the intervals, (B, N − 1, n_between)."""
    size, intervals, nu = trajectory.controls.shape
    if not problem.n_between:
        return np.zeros((size, intervals, 0))
    states = trajectory.states[:, :-1].reshape(size * intervals, problem.system.nx)
    lengths = np.repeat(trajectory.step, intervals)[:, None]
    arguments = states, trajectory.controls.reshape(-1, nu), np.repeat(contexts, intervals, axis=0), lengths
    values = problem.functions.between()(*arguments)[0]
    return np.asarray(np.maximum(-values, 0.0).reshape(size, intervals, problem.n_between))


def _mixed(problem: OptimalControlProblem, trajectory: Trajectory, contexts: Array) -> Array:
    """By how much the constraints on states and controls are violated, (B, N − 1, nm)."""
    size, intervals, nu = trajectory.controls.shape
    if not sum(problem.n_mixed):
        return np.zeros((size, intervals, 0))
    states = trajectory.states[:, :-1].reshape(size * intervals, problem.system.nx)
    arguments = states, trajectory.controls.reshape(-1, nu), np.repeat(contexts, intervals, axis=0)
    inequalities, equalities = problem.functions.mixed()(*arguments)
    violated = np.concatenate([np.maximum(-inequalities, 0.0), np.abs(equalities)], axis=1)
    return np.asarray(violated.reshape(size, intervals, sum(problem.n_mixed)))


def _shortfall(problem: OptimalControlProblem, trajectory: Trajectory, contexts: Array) -> Array:
    """How far clearances are below 0, (B, N, nh)."""
    size, knots, nx = trajectory.states.shape
    (clearance,) = problem.functions.clearances()(trajectory.states.reshape(-1, nx), np.repeat(contexts, knots, axis=0))
    return np.asarray(np.maximum(-clearance.reshape(size, knots, problem.n_clearances), 0.0))


def path_violation(problem: OptimalControlProblem, trajectory: Trajectory, contexts: Array) -> Array:
    """Maximum violation of the path constraints of ``problem`` at the knots, (B,), in the clearances' unit.

    0 without constraints; NaN for a ``trajectory`` that is not finite. The instances have ``contexts`` (B, nc).
    """
    return np.asarray(_shortfall(problem, trajectory, contexts).max(axis=(1, 2), initial=0.0))
