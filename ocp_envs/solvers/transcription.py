"""Direct transcription of an optimal control problem into a scaled nonlinear program.

With N knots, intervals of equal length h = t_f/(N−1) and controls constant within an interval, the program is

    minimise    (Σ_k cost(x_k, u_k, s, h_k) + φ(x_{N−1}, s)) / cost_scale
    subject to  x_{k+1} − F(x_k, u_k, s, h_k) = 0,   h_{k+1} − h_k = 0,   clearances(x_k, s) ≥ 0   (k ≥ 1),
                mixed(x_k, u_k, s) ≥ 0 or = 0   (k ≤ N − 2),   final(x_{N−1}, s) ≥ 0 or = 0,

where F and cost are ``problem.formulation.flow`` (Betts, *Practical Methods for Optimal Control and Estimation*, ch.
4), x_0 and the context s are parameters, and x_{N−1} is within ±``GOAL_TOLERANCE`` (in scaled units) of the target. The
step h is one more state, so that the program has the stagewise structure that fatrop exploits:

    w = [h_0, u_0 | x_1, h_1, u_1 | … | x_{N−1}, h_{N−1}]
    g = [defect_0, mixed_0 | defect_1, clearances_1, mixed_1 | … | clearances_{N−1}, final]

All variables are scaled to order one: states by their scale, controls as the deviation from the control that keeps the
system at the goal, by their scale, and h by half its upper bound. The cost is scaled by a power of 100 where a typical
cost is not between 1 and 100, since the solvers' tolerances are absolute. The target enters through the bounds of the
last knot. They form a small box because fatrop stagnates on equalities there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.stages import Stages, cost_scale
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.kept import kept
from ocp_envs.trajectory import Trajectory

#: Half width of the box around the target, in scaled units.
GOAL_TOLERANCE = 1e-5
#: Programs of up to this many scalar operations are expanded; longer ones call one function per interval. A small
#: program is evaluated faster when expanded, but a long one takes minutes to compile.
_EXPANDED = 10_000


class Rows(NamedTuple):
    """Indices in g of each constraint.

    ``defects`` (N − 1, nx + 1) belong to the intervals, ``clearances`` (N − 1, nh) to the knots k ≥ 1, ``mixed``
    (N − 1, nm) to the knots k ≤ N − 2 and ``final`` (nf,) to the last one; ``unbounded`` are those that are ≥ 0.
    """

    defects: Ints
    clearances: Ints
    mixed: Ints
    final: Ints
    unbounded: Ints


class Counts(NamedTuple):
    """Numbers of constraints: ``clearances``, and those ≥ 0 and = 0 among the ``mixed`` and the ``final`` ones.

    The last ``between`` of those ≥ 0 among the mixed ones are clearances between two knots.
    """

    clearances: int
    mixed: tuple[int, int]
    final: tuple[int, int]
    between: int


@dataclass(frozen=True, eq=False)
class Transcription:
    """A nonlinear program and the layout of its variables; holds no reference to the problem and can be pickled.

    The program ``nlp`` is (w, [x_0; s]) → (f, g), with the functions ``interval``, (x_k, h_k, u_k), s → (x_{k+1},
    h_{k+1}), cost, ``clearance``, x_k, s → clearances, ``mixed``, (x_k, h_k, u_k), s → constraints, and ``final``,
    x_{N−1}, s → constraints, terminal cost, all scaled; its sizes are ``knots``, ``nx``, ``nu`` and ``counts``, and its
    scaled variables x / ``state_scale``, (u − ``control_centre``) / ``control_scale`` and h / ``step_scale``; f is
    J / ``cost_scale``. Without the goal, w has the bounds ``lower`` and ``upper`` (nw,). The function ``ends``, s →
    sides of the targets (nx, W) twice, bounds of h (2,), is that of all contexts if it does not depend on s.
    """

    nlp: ca.Function
    interval: ca.Function
    clearance: ca.Function
    mixed: ca.Function
    final: ca.Function
    ends: ca.Function
    knots: int
    nx: int
    nu: int
    counts: Counts
    state_scale: Array
    control_scale: Array
    control_centre: Array
    step_scale: float
    cost_scale: float
    lower: Array
    upper: Array

    @property
    def n_clearances(self) -> int:
        return self.counts.clearances

    @property
    def intervals(self) -> int:
        return self.knots - 1

    @cached_property
    def structure(self) -> dict[str, object]:
        """The stagewise structure in fatrop's options."""
        m, mixed = self.intervals, sum(self.counts.mixed)
        return {
            "structure_detection": "manual",
            "N": m,
            "nx": [1] + [self.nx + 1] * m,
            "nu": [self.nu] * m + [0],
            "ng": [mixed] + [self.n_clearances + mixed] * (m - 1) + [self.n_clearances + sum(self.counts.final)],
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
    def rows(self) -> Rows:
        """Where each constraint is in g."""
        m, defect, (clear, mixed, final, _) = self.intervals, self.nx + 1, self.counts
        width = defect + clear + sum(mixed)
        first = np.arange(m) * width - np.where(np.arange(m) > 0, clear, 0)  # no clearances at the first knot
        after = first + defect + np.where(np.arange(m) > 0, clear, 0)
        last = width * m - clear
        clearances = np.append(first[1:] + defect, last)[:, None] + np.arange(clear)
        of_mixed = after[:, None] + np.arange(sum(mixed))
        at_end = last + clear + np.arange(sum(final))
        unbounded = [clearances.ravel(), of_mixed[:, : mixed[0]].ravel(), at_end[: final[0]]]
        return Rows(first[:, None] + np.arange(defect), clearances, of_mixed, at_end, np.concatenate(unbounded))

    @cached_property
    def constraint_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of g."""
        lower = np.zeros(self.nlp.numel_out("g"))
        upper = lower.copy()
        upper[self.rows.unbounded] = np.inf
        return lower, upper

    @cached_property
    def _constant_ends(self) -> tuple[Array, Array, Array] | None:
        """The values of ``ends`` where they do not depend on the context."""
        depends = any(self.ends.sparsity_jac(0, i).nnz() for i in range(3)) if self.ends.size1_in(0) else False
        return None if depends else self._ends_of(np.zeros(self.ends.size1_in(0)))

    def _ends_of(self, context: Array) -> tuple[Array, Array, Array]:
        lower, upper, steps = (np.array(part) for part in self.ends(context))
        return lower.T, upper.T, steps.ravel()

    def lower_sides(self, margin: Array) -> Array:
        """Lower bounds of g where the clearances at the knots k ≥ 1 are at least the ``margin`` (N − 1,).

        Between two knots they are at least the smaller margin of both, that of the first knot being 0.
        """
        lower = self.constraint_bounds[0].copy()
        lower[self.rows.clearances] = margin[:, None]
        last, count = self.counts.mixed[0], self.counts.between
        smaller = np.minimum(np.concatenate([np.zeros(1), margin[:-1]]), margin)
        lower[self.rows.mixed[:, last - count : last]] = smaller[:, None]
        return lower

    def bounds(self, target: int, context: Array) -> tuple[Array, Array]:
        """Bounds of w for the goal's target with the index ``target`` in a ``context`` (nc,)."""
        lower, upper = self.lower.copy(), self.upper.copy()
        low, high, steps = self._constant_ends or self._ends_of(context)
        lower[self._is_step], upper[self._is_step] = steps
        last = slice(-(self.nx + 1), -1)
        lower[last] = np.maximum(lower[last], low[target] - GOAL_TOLERANCE)
        upper[last] = np.minimum(upper[last], high[target] + GOAL_TOLERANCE)
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

    def with_duration(self, w: Array, fraction: float, lower: Array, upper: Array) -> Array:
        """Variables ``w`` (nw,) with the duration at ``fraction`` of its upper bound, or at the lower one if longer.

        The bounds of w are ``lower`` and ``upper`` (nw,).
        """
        return np.where(self._is_step, np.maximum(fraction * upper, lower), w)

    def clearance_multipliers(self, lam_g: Array) -> Array:
        """Multipliers of the clearances at the knots k ≥ 1, (N − 1, nh), positive where the constraint is active.

        CasADi's multipliers ``lam_g`` (ng,) of g are negative at lower bounds. Clearances are not scaled, so these are
        −∂J/∂(clearance), in units of cost per unit of clearance.
        """
        return np.maximum(-lam_g[self.rows.clearances], 0.0) * self.cost_scale


def _present(knots: int, nx: int, nu: int) -> NDArray[np.bool_]:
    present = np.ones((knots, nx + 1 + nu), dtype=bool)
    present[0, :nx] = False
    present[-1, nx + 1 :] = False
    return present


@kept
def transcribe(problem: OptimalControlProblem) -> Transcription:
    """The nonlinear program of ``problem``."""
    system, knots = problem.system, problem.knots
    longest = problem.horizon.longest / (knots - 1)
    step_scale, centre = longest / 2, problem.terminal.central_control
    present = _present(knots, system.nx, system.nu)

    def scaled(state: Array, step: float, control: Array) -> Array:
        scaled_control = (control - centre) / system.control.scale
        row = np.concatenate([state / system.state.scale, np.array([step / step_scale]), scaled_control])
        return np.tile(row, (knots, 1))[present]

    per_cost = cost_scale(problem)
    stages = Stages.of(problem, centre, step_scale, per_cost)
    states, controls = problem.planned_states, problem.planned_controls
    return Transcription(
        nlp=_program(problem, stages),
        **stages._asdict(),
        ends=_ends(problem, step_scale),
        knots=knots,
        nx=system.nx,
        nu=system.nu,
        counts=Counts(
            clearances=problem.n_clearances,
            mixed=(problem.n_mixed[0] + problem.n_between, problem.n_mixed[1]),
            final=(problem.terminal.n_inequalities, problem.terminal.n_equalities),
            between=problem.n_between,
        ),
        state_scale=system.state.scale,
        control_scale=system.control.scale,
        control_centre=centre,
        step_scale=step_scale,
        cost_scale=per_cost,
        lower=scaled(states.lower, 0.0, controls.lower),
        upper=scaled(states.upper, longest, controls.upper),
    )


def _ends(problem: OptimalControlProblem, step_scale: float) -> ca.Function:
    _, _, s = problem.symbols()
    steps = problem.formulation.durations(s) / (problem.knots - 1) / step_scale
    return ca.Function("ends", [s], [*problem.terminal.scaled_sides(s), ca.SX(steps)])


def _program(problem: OptimalControlProblem, functions: Stages) -> ca.Function:
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
    following, costs = functions.interval.map(m)(ca.horzcat(*stages[:-1]), contexts)
    defects, free = ends - following, functions.clearance.map(m)(ends[:nx, :], contexts)
    mixed = functions.mixed.map(m)(ca.horzcat(*stages[:-1]), contexts)
    final, end = functions.final(ends[:nx, -1], context)
    within = ca.vec(ca.vertcat(defects[:, 1:], free[:, :-1], mixed[:, 1:]))
    rows = ca.vertcat(defects[:, 0], mixed[:, 0], within, free[:, -1], final)
    cost = ca.sum2(costs) if problem.terminal_cost is None else ca.sum2(costs) + end
    nlp = ca.Function("nlp", [w, parameter], [cost, rows], ["x", "p"], ["f", "g"])
    expanded = nlp.expand()
    return expanded if expanded.n_nodes() <= _EXPANDED else nlp
