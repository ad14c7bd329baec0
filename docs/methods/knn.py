"""Nearest neighbours with a local linear correction, as somebody from outside would write it.

    python -m moe_policy.score knn:make --env PendulumSwingup-v0      # in the folder of this file

The plan is a linear model of the trajectories of some stored neighbours, fitted by least squares around p. Where these
belong to several kinds of trajectories, an average would be of no kind, so only those count that are like the nearest.
"""

import numpy as np

import moe_policy
from ocp_envs import OptimalControlProblem, Trajectory

#: Neighbours that are looked at, those of them that are fitted, and the ridge of the fit.
NEIGHBOURS, FITTED, RIDGE = 16, 8, 1e-3


class LocalLinear:
    """Local linear models of the stored trajectories of ``nearest``."""

    def __init__(self, problem: OptimalControlProblem, nearest: moe_policy.NearestPlanner) -> None:
        self.problem, self.nearest = problem, nearest
        self.p, self.z = nearest.parameters, nearest.trajectory.flat()
        self.width = problem.parameters.upper - problem.parameters.lower
        self.spread = self.z.std(axis=0) + 1e-6
        self.parameters_total = self.p.size + self.z.size

    def __call__(self, parameters: np.ndarray) -> Trajectory:
        """The plans of ``parameters`` (B, np)."""
        p = np.atleast_2d(parameters)
        rows = self.nearest.neighbours(p, NEIGHBOURS)
        return self.problem.unflatten(np.stack([self._plan(each, near) for each, near in zip(p, rows)]))

    def _plan(self, p: np.ndarray, rows: np.ndarray) -> np.ndarray:
        unlike = np.linalg.norm((self.z[rows] - self.z[rows[0]]) / self.spread, axis=1)
        rows = rows[np.argsort(unlike)[:FITTED]]
        offset = (self.p[rows] - p) / self.width
        weight = np.exp(-np.sum(offset**2, axis=1) / (1e-9 + np.median(np.sum(offset**2, axis=1))))
        design = np.column_stack([np.ones(len(rows)), offset])
        left = design.T @ (weight[:, None] * design) + RIDGE * weight.sum() * np.diag([0.0, *offset.var(axis=0)])
        return np.linalg.lstsq(left, design.T @ (weight[:, None] * self.z[rows]), rcond=None)[0][0]


def make(problem: OptimalControlProblem) -> LocalLinear:
    """The method for ``problem``, from the solutions that are shipped with the package."""
    return LocalLinear(problem, moe_policy.load(problem, "nearest", kind=moe_policy.NearestPlanner))
