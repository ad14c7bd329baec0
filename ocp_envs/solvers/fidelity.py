"""What solved trajectories leave open between their knots: the error of the Runge-Kutta steps, and constraints.

The nonlinear program integrates each interval with a few Runge-Kutta steps, and holds constraints at the knots. Whether
the steps are enough, and how far a trajectory enters a constraint between two knots, is measured on a few solutions:
DOP853 integrates each interval from its first knot (:mod:`ocp_envs.solvers.accuracy`), and each interval is followed to
a few points inside it.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.accuracy import integrate
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: Largest error of an interval that passes without a warning, in scales of the state coordinates.
INTERVAL_TOLERANCE = 1e-2
#: Largest depth between knots that passes without a warning, as a fraction of the clearance's range along trajectories.
DEPTH_TOLERANCE = 1e-3
#: Points inside each interval at which constraints are evaluated.
_INSIDE = 4


@checked
@dataclass(frozen=True, eq=False)
class Fidelity:
    """What B ≥ 0 solved trajectories of ``problem`` leave open between their knots.

    Args:
        problem: the problem.
        error: largest error of each interval's end against the true equation, over its coordinates, each divided by its
            scale, (B, N − 1); NaN where the equation cannot be integrated.
        depth: how far each trajectory enters each clearance between its knots, in its unit, (B, nh); 0 for not at all.
        range: largest minus smallest value of each clearance along all trajectories, (nh,).
    """

    problem: OptimalControlProblem
    error: Array
    depth: Array
    range: Array

    @property
    def largest_error(self) -> float:
        """The largest error of an interval, in scales; NaN without trajectories."""
        finite = self.error[np.isfinite(self.error)]
        return float(finite.max()) if len(finite) else np.nan

    @property
    def largest_depth(self) -> float:
        """The largest depth in any clearance; 0 without constraints on the path."""
        return float(self.depth.max(initial=0.0))

    @property
    def faults(self) -> tuple[str, ...]:
        """What exceeds its tolerance, and what to do, in a sentence each."""
        return (*self._inaccurate(), *self._deep())

    @property
    def text(self) -> str:
        """What was measured, in a sentence."""
        if not len(self.error):
            return "no solution was measured"
        told = f"on {len(self.error)} solutions intervals are accurate to {self.largest_error:.1g} of the scales"
        told += f" (tolerance {INTERVAL_TOLERANCE:g})"
        return told + (f", and clearances are entered by at most {self.largest_depth:.2g}" if len(self.range) else "")

    def warn(self, level: int) -> None:
        """Warn of each of the faults, as from the function that is ``level`` above the caller."""
        for fault in self.faults:
            warnings.warn(f"{self.problem.id}: {fault}", stacklevel=level + 1)

    def _inaccurate(self) -> list[str]:
        if not self.largest_error > INTERVAL_TOLERANCE:
            return []
        above, finite = int((self.error > INTERVAL_TOLERANCE).sum()), int(np.isfinite(self.error).sum())
        return [
            f"{self.problem.substeps} Runge-Kutta substeps are too few: on {len(self.error)} solutions {above} of "
            f"{finite} intervals end off the true motion by more than {INTERVAL_TOLERANCE:g} of a coordinate's scale, "
            f"the worst by {self.largest_error:.2g}; raise substeps or knots"
        ]

    def _deep(self) -> list[str]:
        depth = self.depth.max(axis=0, initial=0.0)
        found = []
        for i in np.flatnonzero(depth > DEPTH_TOLERANCE * self.range):
            entered = int((self.depth[:, i] > DEPTH_TOLERANCE * self.range[i]).sum())
            found.append(
                f"between the points at which plans keep constraints, {entered} of {len(self.depth)} solutions enter "
                f"clearance {i} by up to {depth[i]:.2g} (its unit); raise clearance_points, or subtract a margin"
            )
        return found


def fidelity(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory) -> Fidelity:
    """What B solved trajectories ``trajectory`` of ``problem`` with ``parameters`` (B, np) leave open between knots."""
    size, intervals, nu = trajectory.controls.shape
    _, contexts = problem.start(parameters)
    if not size:
        return Fidelity(problem, np.empty((0, intervals)), np.empty((0, problem.n_clearances)), np.empty(0))
    begins = trajectory.states[:, :-1].reshape(size * intervals, problem.system.nx)
    controls, s = trajectory.controls.reshape(-1, nu), np.repeat(contexts, intervals, axis=0)
    h = np.repeat(trajectory.step, intervals)
    error = integrate(problem.functions.rate(), begins, controls, s, h) - trajectory.states[:, 1:].reshape(begins.shape)
    largest = np.abs(error / problem.system.state.scale).max(axis=1).reshape(size, intervals)
    depth, spread = _depths(problem, trajectory, contexts)
    return Fidelity(problem, largest, depth, spread)


def clearances_inside(
    problem: OptimalControlProblem, contexts: Array, trajectory: Trajectory, fractions: Array, substeps: int
) -> Array:
    """The clearances inside the intervals of B trajectories, (F, B, N − 1, nh).

    Args:
        problem: the problem.
        contexts: of the instances, (B, nc).
        trajectory: B trajectories.
        fractions: where in each interval, from 0 at its first knot to 1 at its last, (F,).
        substeps: Runge-Kutta steps from the first knot to each point.
    """
    size, intervals, nu = trajectory.controls.shape
    begins, controls = (
        trajectory.states[:, :-1].reshape(size * intervals, problem.system.nx),
        trajectory.controls.reshape(-1, nu),
    )
    s, h = np.repeat(contexts, intervals, axis=0), np.repeat(trajectory.step, intervals)[:, None]
    flow, clearances = problem.functions.flow(substeps), problem.functions.clearances()
    values = [clearances(flow(begins, controls, s, fraction * h)[0], s)[0] for fraction in fractions]
    return np.array(values).reshape(len(fractions), size, intervals, problem.n_clearances)


def _depths(problem: OptimalControlProblem, trajectory: Trajectory, contexts: Array) -> tuple[Array, Array]:
    """Depth between the knots (B, nh), and range (nh,), of the clearances along ``trajectory`` (B) in ``contexts``."""
    size, knots, nx = trajectory.states.shape
    if not problem.n_clearances:
        return np.zeros((size, 0)), np.zeros(0)
    (at_knots,) = problem.functions.clearances()(trajectory.states.reshape(-1, nx), np.repeat(contexts, knots, axis=0))
    fractions = np.arange(1, _INSIDE + 1) / (_INSIDE + 1)
    inside = clearances_inside(problem, contexts, trajectory, fractions, problem.substeps)
    every = np.concatenate([at_knots.reshape(size, knots, -1), *inside], axis=1)
    violated = np.maximum(-every, 0.0).max(axis=1)
    spread = every.max(axis=(0, 1)) - every.min(axis=(0, 1))
    return np.asarray(violated), np.asarray(spread)
