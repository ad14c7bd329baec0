"""The cost of discretisation: how much an optimal plan costs more than the optimum in continuous time.

A plan has N knots and holds its controls between them, so its optimum costs more than that of the continuous-time
problem. Two independent estimates of the latter start from the plan:

- *held*: the same transcription on grids with m times as many intervals, whose optima decrease towards it;
- *collocation*: compressed Hermite-Simpson collocation on the finest of these grids, with controls quadratic between
  knots (Betts, *Practical Methods for Optimal Control and Estimation*, ch. 4), solved with IPOPT.

Path constraints hold at the knots of each grid.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import Provenance
from ocp_envs.trajectory import Trajectory

#: Grids of the held estimate, as multiples of the intervals of a plan; collocation uses the last.
FINER = (2, 4)
COLLOCATION = "collocation"


def refined(trajectory: Trajectory, factor: int) -> Trajectory:
    """Plans on a grid with ``factor`` times as many intervals: states interpolated, controls repeated."""
    states, count = trajectory.states, trajectory.controls.shape[1]
    weight = (np.arange(count * factor + 1) % factor / factor)[:, None]
    before = np.minimum(np.arange(count * factor + 1) // factor, count)
    after = np.minimum(before + 1, count)
    finer = states[:, before] * (1 - weight) + states[:, after] * weight
    return Trajectory(finer, np.repeat(trajectory.controls, factor, axis=1), trajectory.duration)


def held_costs(problem: OptimalControlProblem, parameters: Array, plans: Trajectory, factor: int) -> Array:
    """Optimal costs (B,) on a grid with ``factor`` times as many intervals, from ``plans``; +inf without a solution."""
    finer = dataclasses.replace(problem, knots=(problem.knots - 1) * factor + 1)
    with GuardedSolver(finer) as solver:
        windings = np.full(len(parameters), NEAREST_WINDING)
        return solver.solve(parameters, refined(plans, factor), windings).cost


class Collocation:
    """The optimum of one instance by compressed Hermite-Simpson collocation on ``intervals``."""

    def __init__(self, problem: OptimalControlProblem, intervals: int) -> None:
        self.problem, self.intervals = problem, intervals
        nx, nu, nc = problem.system.nx, problem.system.nu, len(problem.context)
        self._scale = np.r_[problem.system.state.scale, problem.system.control.scale]
        x, u, s = problem.symbols()
        rate = ca.Function("rate", [x, u, s], [problem.rate(x, u, s)])
        clearance = ca.Function("clearance", [x, s], [problem.clearances(x, s)])
        states, at_knots = ca.MX.sym("x", nx, intervals + 1), ca.MX.sym("u", nu, intervals + 1)
        between, duration = ca.MX.sym("v", nu, intervals), ca.MX.sym("T")
        context, start, target = ca.MX.sym("s", nc), ca.MX.sym("x0", nx), ca.MX.sym("goal", nx)
        xs = states * ca.DM(problem.system.state.scale)
        us, vs = (value * ca.DM(problem.system.control.scale) for value in (at_knots, between))
        h = duration / intervals
        f = rate.map(intervals + 1)(xs, us, ca.repmat(context, 1, intervals + 1))
        f0, f1, x0, x1 = f[:, :-1], f[:, 1:], xs[:, :-1], xs[:, 1:]
        middle = (x0 + x1) / 2 + h / 8 * (f0[:nx, :] - f1[:nx, :])
        fm = rate.map(intervals)(middle, vs, ca.repmat(context, 1, intervals))
        simpson = h / 6 * (f0 + 4 * fm + f1)
        defects = (x1 - x0 - simpson[:nx, :]) / ca.DM(problem.system.state.scale)
        ends = ca.vertcat((xs[:, 0] - start), (xs[:, -1] - target)) / ca.DM(np.tile(problem.system.state.scale, 2))
        clear = clearance.map(intervals)(xs[:, 1:], ca.repmat(context, 1, intervals))
        self._equalities, self._inequalities = int(ca.vertcat(ca.vec(defects), ends).numel()), int(clear.numel())
        self._solver = ca.nlpsol(
            "collocation",
            "ipopt",
            {
                "x": ca.vertcat(ca.vec(states), ca.vec(at_knots), ca.vec(between), duration),
                "p": ca.vertcat(context, start, target),
                "f": ca.sum2(simpson[nx, :]),
                "g": ca.vertcat(ca.vec(defects), ends, ca.vec(clear)),
            },
            {"ipopt": {"print_level": 0, "tol": 1e-8, "max_iter": 500, "mu_init": 1e-3}, "print_time": False},
        )

    def cost(self, p: Array, plan: Trajectory) -> float:
        """The optimal cost of ``p`` (np,); +inf where IPOPT fails, which starts from ``plan``, one on this grid."""
        problem, (states, controls) = self.problem, (plan.states[0], plan.controls[0])
        (start,), (context,) = problem.start(p[None])
        target = problem.targets[np.abs(problem.targets - states[-1]).sum(axis=1).argmin()]
        at_knots = np.concatenate([controls, controls[-1:]])
        parts = [(states, problem.system.state), (at_knots, problem.system.control), (controls, problem.system.control)]
        found = self._solver(
            x0=np.concatenate([*((value / box.scale).ravel() for value, box in parts), plan.duration]),
            p=np.r_[context, start, target],
            lbx=np.concatenate([*(np.tile(box.lower / box.scale, len(v)) for v, box in parts), problem.duration[:1]]),
            ubx=np.concatenate([*(np.tile(box.upper / box.scale, len(v)) for v, box in parts), problem.duration[1:]]),
            lbg=0,
            ubg=np.r_[np.zeros(self._equalities), np.full(self._inequalities, np.inf)],
        )
        return float(found["f"]) if self._solver.stats()["success"] else np.inf


@dataclass(frozen=True, kw_only=True)
class Excess(Record):
    """How much plans cost more than an estimate of the optimum in continuous time, in per cent."""

    estimate: str  # ``"held ×m"`` or ``"collocation"``
    intervals: int  # of the estimate's grid
    cases: int  # instances on which the estimate was solved
    mean: float  # of the excess cost, %, and so on
    quantile_95: float
    maximum: float


@dataclass(frozen=True, kw_only=True)
class Discretisation(Record):
    """The record of ``scripts/check_discretisation.py``."""

    env_id: str  # the problem
    cases: int  # validation instances
    intervals: int  # intervals of a plan
    rows: tuple[Excess, ...]  # one for each estimate
    seconds: float  # wall time
    provenance: Provenance  # where the record comes from


COLUMNS: Sequence[Column[Excess]] = (
    Column("optimum in continuous time, estimated by", lambda row: row.estimate),
    Column("intervals", lambda row: row.intervals),
    Column("instances", lambda row: row.cases),
    Column("excess cost, mean, %", lambda row: row.mean, ".3f"),
    Column("95 % quantile", lambda row: row.quantile_95, ".3f"),
    Column("maximum", lambda row: row.maximum, ".3f"),
)


def excess(estimate: str, intervals: int, plans: Array, optimum: Array) -> Excess:
    """The excess of the costs ``plans`` (B,) over the estimated ``optimum`` (B,), +inf where unknown."""
    known = np.isfinite(optimum) & np.isfinite(plans)
    percent = 100 * (plans[known] / optimum[known] - 1)
    high, maximum = np.quantile(percent, [0.95, 1.0]).tolist()
    return Excess(
        estimate=estimate,
        intervals=intervals,
        cases=int(known.sum()),
        mean=float(percent.mean()),
        quantile_95=high,
        maximum=maximum,
    )


def estimates(problem: OptimalControlProblem, parameters: Array, plans: Trajectory) -> Mapping[str, tuple[int, Array]]:
    """Intervals of the grid, and costs (B,), of each estimate of the optimum in continuous time, from ``plans``."""
    coarse = problem.knots - 1
    found: dict[str, tuple[int, Array]] = {
        f"held ×{factor}": (coarse * factor, held_costs(problem, parameters, plans, factor)) for factor in FINER
    }
    collocation, fine = Collocation(problem, coarse * FINER[-1]), refined(plans, FINER[-1])
    shown = track(enumerate(parameters), len(parameters), unit="instance", label="collocation", leave=False)
    costs = [collocation.cost(p, fine[i : i + 1]) for i, p in shown]
    return found | {COLLOCATION: (coarse * FINER[-1], np.array(costs))}
