"""The terminal set of a problem: its goal, evaluated for the instances of the problem.

With A alternatives and V windings there are W = A·V *targets*, boxes {x | lower ≤ x ≤ upper} whose sides are a point
where a coordinate is fixed and infinite where it is free. The terminal set is their union, modulo whole turns, as far
as the final constraints ψ(x, s, c) ≥ 0 and χ(x, s, c) = 0 hold in it. The distance of a state from it is

    e(x) = min over the alternatives of ‖ [(x ⊖ its box) / tolerance,  min(ψ, 0),  χ] ‖,

and the goal ball is e < radius.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ocp_envs.expressions import called, column
from ocp_envs.goal import Goal, sides
from ocp_envs.support.arrays import Array, Bools, frozen_array
from ocp_envs.support.batch import BatchFunction, dense_function
from ocp_envs.support.doors import checked
from ocp_envs.system import Expression, wrap

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


class TerminalSet:
    """The terminal set of ``problem``.

    Attributes:
        goal: its declaration.
        depends: whether the targets or the control at the goal depend on the context.
        fixed: which coordinates are fixed in all alternatives, (nx,).
        n_inequalities, n_equalities: number of final constraints ψ and χ.

    Raises:
        ValueError: functions that fail or return something else, or sides in the wrong order.
    """

    @checked
    def __init__(self, problem: OptimalControlProblem) -> None:
        self.goal: Goal = problem.goal
        self._id, self._system, self._central = problem.id, problem.system, problem.context.centre[None]
        self._namespaces = problem.formulation.namespaces
        x, _, s = problem.symbols()
        self._s = s
        self._lower, self._upper, self._control = self._expressions(s)
        together = ca.vertcat(ca.vec(self._lower), ca.vec(self._upper), self._control)
        self.depends = bool(len(ca.symvar(together)))
        self.fixed: Bools = np.array(
            [all(ca.is_equal(low, high, 3) for low, high in zip(*pair)) for pair in self._columns()], dtype=bool
        )
        self.n_inequalities, self.n_equalities = (int(part.shape[0]) for part in self.constraints(x, s))

    def _columns(self) -> list[tuple[list[ca.SX], list[ca.SX]]]:
        """Sides of each coordinate in every alternative."""
        return [(ca.horzsplit(self._lower[i, :]), ca.horzsplit(self._upper[i, :])) for i in range(self._system.nx)]

    def _expressions(self, s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Sides (nx, A) and control (nu, 1) at the goal as expressions in ``s`` (nc, 1)."""
        context, constants, _ = self._namespaces(s)
        goal, system, what = self.goal, self._system, f"{self._id}: goal"
        declared = goal.state
        if callable(declared):
            declared = called(f"{what}.state", "context, constants", declared, context, constants)
        pairs = [sides(f"{what}.state", row, system.state.names) for row in goal.alternatives_of(declared)]
        lower, upper = (ca.horzcat(*[ca.vertcat(*row) for row in part]) for part in zip(*pairs))
        control = goal.control
        if callable(control):
            control = called(f"{what}.control", "context, constants", control, context, constants)
        held = np.zeros(system.nu) if control is None else control
        if len(held) != system.nu:
            raise ValueError(f"{what}.control must have {system.nu} components, got {len(held)}")
        return ca.SX(lower), ca.SX(upper), ca.SX(column(f"{what}.control", list(held)))

    def expression(self, x: ca.SX, s: ca.SX) -> ca.SX:
        """All that the goal says, as one column in ``x`` (nx, 1) and ``s`` (nc, 1)."""
        lower, upper, control = self._expressions(s)
        return ca.vertcat(ca.vec(lower), ca.vec(upper), control, *self.constraints(x, s))

    @property
    def pinned(self) -> bool:
        """Whether the terminal set is a single state in each context, apart from whole turns."""
        constrained = self.n_inequalities or self.n_equalities
        return bool(self.fixed.all()) and self._lower.shape[1] == 1 and not constrained

    @property
    def plain(self) -> bool:
        """Whether the terminal set is the same single state in all contexts."""
        return self.pinned and not self.depends

    @cached_property
    def _shifts(self) -> Array:
        """Whole turns of each winding in the units of the states, (V, nx)."""
        windings = self.goal.windings_of(self._system.nx)
        return frozen_array(windings * self._system.state.periods)

    def __len__(self) -> int:
        """W, the number of targets."""
        return int(self._lower.shape[1]) * len(self._shifts)

    @cached_property
    def _function(self) -> BatchFunction | None:
        if not self.depends:
            return None
        outputs = [ca.vec(self._lower), ca.vec(self._upper), self._control]
        return BatchFunction(dense_function("terminal_set", [self._s], outputs))

    @cached_property
    def _constant(self) -> tuple[Array, Array, Array]:
        lower, upper, control = (np.array(ca.DM(part)) for part in (self._lower, self._upper, self._control))
        return frozen_array(lower.T.ravel()), frozen_array(upper.T.ravel()), frozen_array(control.ravel())

    def _values(self, contexts: Array) -> tuple[Array, Array, Array]:
        """Sides (B, A, nx) twice and controls (B, nu) in ``contexts`` (B, nc)."""
        shape = len(contexts), int(self._lower.shape[1]), self._system.nx
        if self._function is None:
            parts = [np.broadcast_to(part, (len(contexts), len(part))) for part in self._constant]
        else:
            parts = list(self._function(contexts))
        return parts[0].reshape(shape), parts[1].reshape(shape), parts[2]

    def bounds(self, contexts: Array) -> tuple[Array, Array]:
        """Sides of the targets in ``contexts`` (B, nc), (B, W, nx) each; ±inf where a coordinate is free."""
        lower, upper, _ = self._values(contexts)
        shape = len(contexts), len(self), self._system.nx
        low, high = ((part[:, :, None] + self._shifts).reshape(shape) for part in (lower, upper))
        return low, high

    def nearest(self, states: Array, contexts: Array) -> Array:
        """The state in each target that is nearest to ``states`` (B, nx) in ``contexts`` (B, nc), (B, W, nx)."""
        lower, upper = self.bounds(contexts)
        return np.asarray(np.clip(states[:, None], lower, upper))

    def states(self, contexts: Array) -> Array:
        """A state of the first target in ``contexts`` (B, nc), (B, nx): where coordinates are free, amid their box."""
        lower, upper, _ = self._values(contexts)
        return np.asarray(np.clip(self._system.state.centre, lower[:, 0], upper[:, 0]))

    def controls(self, contexts: Array) -> Array:
        """The control at the goal in ``contexts`` (B, nc), (B, nu)."""
        return np.asarray(self._values(contexts)[2])

    @cached_property
    def central_state(self) -> Array:
        """:meth:`states` in the centre of the contexts, (nx,)."""
        return frozen_array(self.states(self._central)[0])

    @cached_property
    def central_control(self) -> Array:
        """:meth:`controls` in the centre of the contexts, (nu,)."""
        return frozen_array(self.controls(self._central)[0])

    def scaled_sides(self, s: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Sides of the targets divided by the scales, as expressions in ``s`` (nc, 1), (nx, W) each."""
        lower, upper, _ = self._expressions(s)
        count, scale = len(self._shifts), self._system.state.scale

        def scaled(part: ca.SX) -> ca.SX:
            return ca.horzcat(*[(part[:, i // count] + self._shifts[i % count]) / scale for i in range(len(self))])

        return scaled(lower), scaled(upper)

    def distances(self, states: Array, contexts: Array) -> Array:
        """By how much ``states`` (B, nx) miss the nearest alternative in ``contexts`` (B, nc), (B, nx) ≥ 0."""
        lower, upper, _ = self._values(contexts)
        apart = self._apart(states[:, None], lower, upper)
        nearest = np.linalg.norm(apart / self.goal.tolerance_of(self._system.nx), axis=-1).argmin(axis=1)
        return np.asarray(apart[np.arange(len(apart)), nearest])

    def _apart(self, states: Array, lower: Array, upper: Array) -> Array:
        """How far each coordinate of ``states`` is outside the sides ``lower`` and ``upper``, all (..., nx)."""
        apart = np.maximum(lower - states, 0.0) + np.maximum(states - upper, 0.0)
        for i, coordinate in enumerate(self._system.state.coordinates):
            if coordinate.period is not None and np.isfinite(lower[..., i]).all():
                middle, half = (lower[..., i] + upper[..., i]) / 2, (upper[..., i] - lower[..., i]) / 2
                away = np.abs(wrap(states[..., i] - middle, coordinate.period))
                apart[..., i] = np.maximum(away - half, 0.0)
        return np.asarray(apart)

    @cached_property
    def _constraint_function(self) -> BatchFunction | None:
        if not (self.n_inequalities or self.n_equalities):
            return None
        x = ca.SX.sym("x", self._system.nx)
        inequalities, equalities = self.constraints(x, self._s)
        return BatchFunction(dense_function("final", [x, self._s], [ca.fmin(inequalities, 0), equalities]))

    def violations(self, states: Array, contexts: Array) -> Array:
        """By how much ``states`` (B, nx) violate the final constraints in ``contexts`` (B, nc), (B, n) ≥ 0."""
        if self._constraint_function is None:
            return np.zeros((len(states), 0))
        return np.asarray(np.abs(np.concatenate(self._constraint_function(states, contexts), axis=1)))

    def error(self, states: Array, contexts: Array) -> Array:
        """e of ``states`` (..., nx) in ``contexts`` (..., nc), (...)."""
        if self.plain and self.goal.tolerance is None:  # four times as fast, in every control step of a rollout
            return np.asarray(np.linalg.norm(self._system.difference(states, self._constant[0]), axis=-1))
        shape = np.shape(states)[:-1]
        size, width = int(np.prod(shape)), np.shape(contexts)[-1]
        contexts = np.broadcast_to(contexts, (*shape, width)).reshape(size, width)
        x = np.reshape(states, (size, self._system.nx))
        apart = self.distances(x, contexts) / self.goal.tolerance_of(self._system.nx)
        if self._constraint_function is not None:
            apart = np.concatenate([apart, self.violations(x, contexts)], axis=1)
        return np.asarray(np.linalg.norm(apart, axis=-1)).reshape(shape)

    def constraints(self, x: Expression, s: Expression) -> tuple[Expression, Expression]:
        """ψ and χ as columns of expressions in ``x`` (nx, 1) and ``s`` (nc, 1)."""
        context, constants, _ = self._namespaces(s)
        found = []
        for name in ("inequalities", "equalities"):
            function, what = getattr(self.goal, name), f"{self._id}: goal.{name}"
            if function is None:
                found.append(type(x)(0, 1))
            else:
                values = called(what, "state, context, constants", function, ca.vertsplit(x), context, constants)
                found.append(column(what, values))
        return found[0], found[1]

    def squared_error(self, x: ca.SX, s: ca.SX) -> ca.SX:
        """e² as an expression in ``x`` (nx, 1) and ``s`` (nc, 1)."""
        if self.plain and self.goal.tolerance is None:
            return ca.sumsqr(self._system.difference(x, ca.SX(self._constant[0])))
        lower, upper, _ = self._expressions(s)
        tolerance = ca.DM(self.goal.tolerance_of(self._system.nx))
        squares = [
            ca.sumsqr(self._apart_expression(x, lower[:, i], upper[:, i]) / tolerance) for i in range(lower.shape[1])
        ]
        inequalities, equalities = self.constraints(x, s)
        nearest = ca.mmin(ca.vertcat(*squares)) if len(squares) > 1 else squares[0]
        return nearest + ca.sumsqr(ca.fmin(inequalities, 0)) + ca.sumsqr(equalities)

    def _apart_expression(self, x: ca.SX, lower: ca.SX, upper: ca.SX) -> ca.SX:
        apart = []
        for i, coordinate in enumerate(self._system.state.coordinates):
            low, high, free = lower[i], upper[i], _infinite(lower[i]) and _infinite(upper[i])
            if free:
                apart.append(ca.SX(0))
            elif coordinate.period is not None:
                away = ca.fabs(wrap(x[i] - (low + high) / 2, coordinate.period))
                apart.append(ca.fmax(away - (high - low) / 2, 0))
            else:
                below = 0 if _infinite(low) else ca.fmax(low - x[i], 0)
                above = 0 if _infinite(high) else ca.fmax(x[i] - high, 0)
                apart.append(below + above)
        return ca.vertcat(*apart)


def _infinite(side: ca.SX) -> bool:
    return bool(side.is_constant() and np.isinf(float(side)))
