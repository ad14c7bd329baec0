"""How deep optimal plans violate path constraints between knots, for several numbers of points in an interval.

Plans are made with the constraint at the knots, and at points between them (``problem.clearance_points``). Their depth
is that of the motion under the plan's controls, at :data:`SAMPLES` times in each interval.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import residuals
from ocp_envs.solvers.fidelity import clearances_inside
from ocp_envs.solvers.improvement import improve
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance
from ocp_envs.trajectory import Trajectory

#: Times in each interval at which the depth is measured, and Runge-Kutta steps from the knot to each.
SAMPLES, SUBSTEPS = 20, 8


def depths(problem: OptimalControlProblem, parameters: Array, plans: Trajectory) -> Array:
    """The largest violation of the path constraints of ``problem`` along B ``plans``, between knots as well, (B,).

    The instances have ``parameters`` (B, np).
    """
    fractions = np.linspace(0, 1, SAMPLES + 1)
    inside = clearances_inside(problem, problem.start(parameters)[1], plans, fractions, SUBSTEPS)
    return np.asarray(np.maximum(-inside, 0.0).max(axis=(0, 2, 3)))


@dataclass(frozen=True, kw_only=True)
class BetweenKnotsRow(Record):
    """Plans that keep clear at ``points`` of each interval."""

    points: int  # of each interval at which plans keep clear
    solved: int  # instances
    mean: float  # depth on the whole path, m, and so on
    quantile_95: float
    maximum: float
    cost: float  # relative to the plans that keep clear at the knots, summed over instances that both solve
    milliseconds: float  # median time of a solve from the plan that keeps clear at the knots, with its check


@dataclass(frozen=True, kw_only=True)
class BetweenKnots(Record):
    """The record of ``scripts/check_between_knots.py``."""

    env_id: str  # the problem
    cases: int  # validation instances
    rows: tuple[BetweenKnotsRow, ...]
    provenance: Provenance  # where the record comes from


COLUMNS: Sequence[Column[BetweenKnotsRow]] = (
    Column("points of an interval", lambda row: row.points),
    Column("solved", lambda row: row.solved),
    Column("depth on the path, mean, mm", lambda row: 1e3 * row.mean, ".2f"),
    Column("95 % quantile", lambda row: 1e3 * row.quantile_95, ".2f"),
    Column("maximum", lambda row: 1e3 * row.maximum, ".2f"),
    Column("cost", lambda row: row.cost, ".5f"),
    Column("ms a solve", lambda row: row.milliseconds, ".1f"),
)


def with_points(
    problem: OptimalControlProblem, points: int, parameters: Array, plans: Trajectory, costs: Array
) -> BetweenKnotsRow:
    """Solve instances of ``problem`` with ``parameters`` (B, np) from ``plans``, keeping clear at so many ``points``.

    The ``plans`` keep clear at the knots, at the ``costs`` (B,).
    """
    variant, times, found = dataclasses.replace(problem, clearance_points=points), [], []
    improve(variant, parameters[:1], plans[:1])  # compiles, starts the solver
    for p, plan in zip(parameters, plans, strict=True):
        began = time.perf_counter()
        found.append(improve(variant, p[None], plan))
        times.append(time.perf_counter() - began)
    solved = np.concatenate([each.converged for each in found])
    better = Trajectory.concatenate([each.trajectory for each in found])[solved]
    deepest = depths(problem, parameters[solved], better)
    _, cost = residuals(problem, parameters[solved], better)
    high, maximum = np.quantile(deepest, [0.95, 1.0]).tolist()
    return BetweenKnotsRow(
        points=points,
        solved=int(solved.sum()),
        mean=float(deepest.mean()),
        quantile_95=high,
        maximum=maximum,
        cost=float(cost.sum() / costs[solved].sum()),
        milliseconds=1e3 * float(np.median(times)),
    )
