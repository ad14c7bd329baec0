"""Direct transcription of an optimal control problem into a scaled nonlinear program.

With N knots, intervals of equal length h = t_f/(N−1) and controls constant within an interval, the program is

    minimise    Σ_k cost(x_k, u_k, s, h_k) / cost_scale
    subject to  x_{k+1} − F(x_k, u_k, s, h_k) = 0,   h_{k+1} − h_k = 0,   clearances(x_k, s) ≥ 0   (k ≥ 1),

where F and cost are ``problem.flow`` (Betts, *Practical Methods for Optimal Control and Estimation*, ch. 4), x_0 and
the context s are parameters, and x_{N−1} is within ±``GOAL_TOLERANCE`` (in scaled units) of the target. The step h is
one more state, so that the program has the stagewise structure that fatrop exploits:

    w = [h_0, u_0 | x_1, h_1, u_1 | … | x_{N−1}, h_{N−1}]
    g = [defect_0 | defect_1, clearances_1 | … | clearances_{N−1}]

All variables are scaled to order one: states by their scale, controls as the deviation from the control that keeps the
system at the goal, by their scale, and h by half its upper bound. The cost is scaled by a power of 100 where a typical
cost is not between 1 and 100, since the solvers' tolerances are absolute. The target enters through the bounds of the
last knot. They form a small box because fatrop stagnates on equalities there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.points import points_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.kept import kept
from ocp_envs.trajectory import Trajectory

#: Half width of the box around the target, in scaled units.
GOAL_TOLERANCE = 1e-5
#: Programs of up to this many scalar operations are expanded; longer ones call one function per interval. A small
#: program is evaluated faster when expanded, but a long one takes minutes to compile.
_EXPANDED = 10_000


@dataclass(frozen=True, eq=False)
class Transcription:
    """A nonlinear program and the layout of its variables; holds no reference to the problem and can be pickled.

    The program ``nlp`` is (w, [x_0; s]) → (f, g), with the functions ``interval``, (x_k, h_k, u_k), s → (x_{k+1},
    h_{k+1}), cost, and ``clearance``, x_k, s → clearances, all scaled; its sizes are ``knots``, ``nx``, ``nu`` and
    ``n_clearances``, and its scaled variables x / ``state_scale``, (u − ``control_centre``) / ``control_scale`` and
    h / ``step_scale``; f is J / ``cost_scale``. Without the goal, w has the bounds ``lower`` and ``upper`` (nw,);
    ``targets`` (W, nx) are goal states, one per winding.
    """

    nlp: ca.Function
    interval: ca.Function
    clearance: ca.Function
    knots: int
    nx: int
    nu: int
    n_clearances: int
    state_scale: Array
    control_scale: Array
    control_centre: Array
    step_scale: float
    cost_scale: float
    lower: Array
    upper: Array
    targets: Array

    @property
    def intervals(self) -> int:
        return self.knots - 1

    @cached_property
    def structure(self) -> dict[str, object]:
        """The stagewise structure in fatrop's options."""
        m = self.intervals
        return {
            "structure_detection": "manual",
            "N": m,
            "nx": [1] + [self.nx + 1] * m,
            "nu": [self.nu] * m + [0],
            "ng": [0] + [self.n_clearances] * m,
        }

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Which entries of the full table (N, nx + 1 + nu) of (x, h, u) are variables of w, in their order."""
        return _present(self.knots, self.nx, self.nu)

    @cached_property
    def _is_step(self) -> NDArray[np.bool_]:
        """Which variables are steps, (nw,)."""
        column = np.arange(self.nx + 1 + self.nu) == self.nx
        return np.tile(column, (self.knots, 1))[self.present]

    @cached_property
    def clearance_rows(self) -> NDArray[np.int64]:
        """Indices in g of the clearances at the knots k ≥ 1, (N − 1, nh)."""
        defect, count = self.nx + 1, self.n_clearances
        first = 2 * defect + (defect + count) * np.arange(self.intervals)
        first[-1] -= defect  # there is no defect at the last knot
        return first[:, None] + np.arange(count)

    @cached_property
    def constraint_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of g."""
        lower = np.zeros((self.nx + 1 + self.n_clearances) * self.intervals)
        upper = lower.copy()
        upper[self.clearance_rows] = np.inf
        return lower, upper

    def bounds(self, target: Array) -> tuple[Array, Array]:
        """Bounds of w for a goal state ``target`` (nx,)."""
        lower, upper = self.lower.copy(), self.upper.copy()
        last = slice(-(self.nx + 1), -1)
        scaled = target / self.state_scale
        lower[last], upper[last] = scaled - GOAL_TOLERANCE, scaled + GOAL_TOLERANCE
        return lower, upper

    def pack(self, trajectory: Trajectory) -> Array:
        """Scaled variables (B, nw) of the B trajectories of ``trajectory``; the first state is not among them."""
        table = np.zeros((len(trajectory), self.knots, self.nx + 1 + self.nu))
        table[:, :, : self.nx] = trajectory.states / self.state_scale
        table[:, :, self.nx] = (trajectory.step / self.step_scale)[:, None]
        table[:, :-1, self.nx + 1 :] = (trajectory.controls - self.control_centre) / self.control_scale
        return table[:, self.present]

    def unpack(self, w: Array, initial: Array) -> Trajectory:
        """Trajectories of scaled variables ``w`` (B, nw) and initial states ``initial`` (B, nx)."""
        table = np.zeros((len(w), self.knots, self.nx + 1 + self.nu))
        table[:, self.present] = w
        states = table[:, :, : self.nx] * self.state_scale
        states[:, 0] = initial
        controls = table[:, :-1, self.nx + 1 :] * self.control_scale + self.control_centre
        return Trajectory(states, controls, table[:, 0, self.nx] * self.step_scale * self.intervals)

    def with_duration(self, w: Array, fraction: float) -> Array:
        """Variables ``w`` (nw,) with the duration at ``fraction`` of its upper bound, or at the lower one if longer."""
        return np.where(self._is_step, np.maximum(fraction * self.upper, self.lower), w)

    def clearance_multipliers(self, lam_g: Array) -> Array:
        """Multipliers of the clearances at the knots k ≥ 1, (N − 1, nh), positive where the constraint is active.

        CasADi's multipliers ``lam_g`` (ng,) of g are negative at lower bounds. Clearances are not scaled, so these are
        −∂J/∂(clearance), in units of cost per unit of clearance.
        """
        return np.maximum(-lam_g[self.clearance_rows], 0.0) * self.cost_scale


def _present(knots: int, nx: int, nu: int) -> NDArray[np.bool_]:
    present = np.ones((knots, nx + 1 + nu), dtype=bool)
    present[0, :nx] = False
    present[-1, nx + 1 :] = False
    return present


@kept
def transcribe(problem: OptimalControlProblem) -> Transcription:
    """The nonlinear program of ``problem``."""
    system, knots = problem.system, problem.knots
    shortest, longest = (t / (knots - 1) for t in problem.duration)
    step_scale, centre = longest / 2, problem.goal.control
    present = _present(knots, system.nx, system.nu)

    def scaled(state: Array, step: float, control: Array) -> Array:
        scaled_control = (control - centre) / system.control.scale
        row = np.concatenate([state / system.state.scale, np.array([step / step_scale]), scaled_control])
        return np.tile(row, (knots, 1))[present]

    cost_scale = _cost_scale(problem)
    interval, clearance = _interval(problem, step_scale, cost_scale), _clearance(problem)
    return Transcription(
        nlp=_program(problem, interval, clearance),
        interval=interval,
        clearance=clearance,
        knots=knots,
        nx=system.nx,
        nu=system.nu,
        n_clearances=problem.n_clearances,
        state_scale=system.state.scale,
        control_scale=system.control.scale,
        control_centre=centre,
        step_scale=step_scale,
        cost_scale=cost_scale,
        lower=scaled(system.state.lower, shortest, system.control.lower),
        upper=scaled(system.state.upper, longest, system.control.upper),
        targets=problem.targets,
    )


def _cost_scale(problem: OptimalControlProblem) -> float:
    """The power of 100 that brings a typical cost of ``problem`` to between 1 and 100.

    Typical is the median of the cost rate at initial states with the goal's control, or in the box where it is zero
    there, over half the longest duration.
    """
    _, at_starts, in_box = points_of(problem)
    for at in (at_starts, in_box):
        rate = np.abs(problem.batch_rate()(at.states, at.controls, at.contexts)[1])
        usable = rate[np.isfinite(rate) & (rate > 0)]
        if len(usable):
            return float(100.0 ** np.floor(np.log10(np.median(usable) * problem.duration[1] / 2) / 2))
    return 1.0


def _interval(problem: OptimalControlProblem, step_scale: float, cost_scale: float) -> ca.Function:
    """Scaled (x_k, h_k, u_k), s → scaled (x_{k+1}, h_{k+1}) and the scaled cost of the interval."""
    system = problem.system
    x, u, s = problem.symbols()
    h = ca.SX.sym("h")
    scale = ca.DM(system.state.scale)
    control = u * ca.DM(system.control.scale) + ca.DM(problem.goal.control)
    following, cost = problem.flow(x * scale, control, s, h * step_scale, problem.substeps)
    return ca.Function("interval", [ca.vertcat(x, h, u), s], [ca.vertcat(following / scale, h), cost / cost_scale])


def _clearance(problem: OptimalControlProblem) -> ca.Function:
    """Scaled x_k, s → clearances."""
    x, _, s = problem.symbols()
    return ca.Function("clearances", [x, s], [problem.clearances(x * ca.DM(problem.system.state.scale), s)])


def _program(problem: OptimalControlProblem, interval: ca.Function, clearance: ca.Function) -> ca.Function:
    nx, nu, m = problem.system.nx, problem.system.nu, problem.knots - 1
    scale = ca.DM(problem.system.state.scale)
    parameter = ca.MX.sym("p", nx + len(problem.context))
    sizes = [1 + nu] + [nx + 1 + nu] * (m - 1) + [nx + 1]
    w = ca.MX.sym("w", sum(sizes))
    stages = ca.vertsplit(w, [int(i) for i in np.cumsum([0, *sizes])])
    stages[0] = ca.vertcat(parameter[:nx] / scale, stages[0])
    context = parameter[nx:]
    ends = ca.horzcat(*[stage[: nx + 1] for stage in stages[1:]])
    contexts = ca.repmat(context, 1, m)
    following, costs = interval.map(m)(ca.horzcat(*stages[:-1]), contexts)
    defects, free = ends - following, clearance.map(m)(ends[:nx, :], contexts)
    rows = ca.vertcat(defects[:, 0], ca.vec(ca.vertcat(defects[:, 1:], free[:, :-1])), free[:, -1])
    nlp = ca.Function("nlp", [w, parameter], [ca.sum2(costs), rows], ["x", "p"], ["f", "g"])
    expanded = nlp.expand()
    return expanded if expanded.n_nodes() <= _EXPANDED else nlp
