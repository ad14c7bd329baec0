"""A parametric optimal control problem, declared once; everything else is derived from this value.

    minimise    ∫_0^{t_f} L(x, u, s, c) dt      over u(·) and t_f
    subject to  ẋ = f(x, u, c),   x(0) = x_0,   x(t_f) = goal (modulo whole turns),
                x, u in their boxes,   h(x, s, c) ≥ 0,   t_f in its bounds

The parameter p of the problem is what the start and the context are made of: a component of p names a state coordinate
(the start there), or anything else (a *context* coordinate s that stays constant over an episode; where it carries the
name of a physical constant it replaces that constant). ``start(p) → (x_0, s)`` and ``parameters_of(x, s) → p`` are
inverses.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.goal import SINGLE_MODE, Goal, Modes
from ocp_envs.picture import Picture
from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.support.batch import BatchFunction, dense_function
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, System, rk4_step
from ocp_envs.trajectory import Trajectory, flat_size

#: (state, control, context, constants) → L, one expression; context and constants are namespaces.
CostRate = Callable[[Sequence[Any], Sequence[Any], SimpleNamespace, SimpleNamespace], Any]
#: (state, context, constants) → list of expressions that must stay ≥ 0, in metres where they are distances.
Clearance = Callable[[Sequence[Any], SimpleNamespace, SimpleNamespace], Sequence[Any]]

BOX_TOLERANCE = 1e-6


class OutsideBoxError(ValueError):
    """A parameter lies outside the parameter box."""


@dataclass(frozen=True, eq=False)
class OptimalControlProblem:
    """One benchmark problem.

    Args:
        id: name of the environment, such as ``"PendulumSwingup-v0"``.
        title: the problem in half a line.
        system: the controlled system.
        parameters: box of p.
        cost_rate: L.
        goal: the goal ball and its windings.
        duration: bounds of t_f, seconds.
        knots: N, number of knots of a trajectory.
        substeps: Runge-Kutta steps within one interval of the transcription.
        rest: start values of the state coordinates p does not name, (nx,); the goal's state by default.
        clearance: h(x, s, c) ≥ 0, or ``None``.
        modes: families of optimal trajectories; one by default.
        hold: seconds the goal is held before success is judged; 0 where the goal cannot be held.
        time_limit: seconds after which an episode of the environment is truncated.
        picture: how to draw it, or ``None`` for plots over time only.
        free: the problem without the path constraint. Where given, parameters are drawn uniformly *on condition* that
            the constraint matters: start and goal are clear, h > 0, and the optimal trajectory of ``free`` is not. Its
            parameters are some of this problem's, and ``clearance`` must accept NumPy arrays.
        longest_substep: seconds that a Runge-Kutta step of the simulation may last.
        symmetry: a map under which the problem looks the same.

    Raises:
        ValueError: parts that do not fit together, each named.
    """

    id: str
    title: str
    system: System
    parameters: Box
    cost_rate: CostRate
    goal: Goal
    duration: tuple[float, float]
    knots: int
    substeps: int
    hold: float
    time_limit: float
    rest: Array | None = None
    clearance: Clearance | None = None
    modes: Modes = SINGLE_MODE
    picture: Picture | None = None
    free: OptimalControlProblem | None = None
    longest_substep: float = 0.02
    symmetry: Symmetry | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "rest", frozen_array(self.goal.state if self.rest is None else self.rest))
        nx, nu = self.system.nx, self.system.nu
        goal = self.goal
        if goal.state.shape != (nx,) or goal.control.shape != (nu,) or goal.windings.shape[1:] != (nx,):
            raise ValueError(
                f"{self.id}: expected a goal with state ({nx},), control ({nu},), windings (W, {nx}); "
                f"got {goal.state.shape}, {goal.control.shape}, {goal.windings.shape}"
            )
        if np.any(goal.windings[:, self.system.state.periods == 0]):
            raise ValueError(f"{self.id}: a winding is given for a coordinate without a period")
        if not 0 < self.duration[0] < self.duration[1]:
            raise ValueError(f"{self.id}: expected 0 < shortest < longest duration, got {self.duration}")
        if self.knots < 2 or self.substeps < 1:
            raise ValueError(f"{self.id}: expected knots ≥ 2 and substeps ≥ 1, got {self.knots}, {self.substeps}")
        if not 0 < self.longest_substep < np.inf:
            raise ValueError(f"{self.id}: longest_substep must be positive and finite, got {self.longest_substep}")
        if self.free is not None:
            self._check_free(self.free)
        if self.symmetry is not None:
            sizes = len(self.symmetry.state), len(self.symmetry.control), len(self.symmetry.context)
            if sizes != (nx, nu, len(self.context)):
                raise ValueError(
                    f"{self.id}: expected a symmetry of {nx} states, {nu} controls and {len(self.context)} coordinates "
                    f"of the context, got {sizes}"
                )
        if self.rest is not None and self.rest.shape != (nx,):
            raise ValueError(f"{self.id}: rest must have shape ({nx},), got {self.rest.shape}")

    def _check_free(self, free: OptimalControlProblem) -> None:
        unknown = sorted(set(free.parameters.names) - set(self.parameters.names))
        if self.clearance is None or unknown or free.system.state.names != self.system.state.names:
            raise ValueError(
                f"{self.id}: free must be this problem without its path constraint, with the same state and parameters "
                f"from {list(self.parameters.names)}; got {free.id} with parameters {list(free.parameters.names)}"
                + (", and there is no path constraint" if self.clearance is None else "")
            )

    def __reduce__(self) -> tuple[Any, ...]:
        # Without what was derived and cached.
        return OptimalControlProblem, tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    # -- sizes -----------------------------------------------------------------------------------------------------

    @property
    def flat_size(self) -> int:
        """Length of a flat trajectory."""
        return flat_size(self.knots, self.system.nx, self.system.nu)

    def unflatten(self, z: ArrayLike) -> Trajectory:
        """The trajectories of this problem in the flat layout ``z``, (B, flat_size) or (flat_size,).

        Raises:
            ValueError: another length.
        """
        return Trajectory.from_flat(z, self.knots, self.system.nx, self.system.nu)

    @cached_property
    def context(self) -> Box:
        """Coordinates of p that are no state coordinates."""
        return Box(tuple(c for c in self.parameters.coordinates if c.name not in self.system.state.names))

    @cached_property
    def targets(self) -> Array:
        """Goal states, one for each winding, (W, nx)."""
        return frozen_array(self.goal.state + self.goal.windings * self.system.state.periods)

    @cached_property
    def n_clearances(self) -> int:
        if self.clearance is None:
            return 0
        context = SimpleNamespace(**{n: ca.SX.sym(n) for n in self.context.names})
        return len(
            self.clearance(
                ca.vertsplit(ca.SX.sym("x", self.system.nx)), context, SimpleNamespace(**self.system.constants)
            )
        )

    # -- parameters ------------------------------------------------------------------------------------------------

    @cached_property
    def _state_slots(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        names = self.system.state.names
        in_state = [i for i, n in enumerate(self.parameters.names) if n in names]
        slots = [names.index(self.parameters.names[i]) for i in in_state]
        in_context = [i for i, n in enumerate(self.parameters.names) if n not in names]
        return np.array(in_state, np.int64), np.array(slots, np.int64), np.array(in_context, np.int64)

    def check_parameters(self, p: ArrayLike, extrapolate: bool = False) -> Array:
        """``p`` as a float64 array (B, np).

        Args:
            p: (B, np) or (np,).
            extrapolate: accept parameters outside the box (never non-finite ones).

        Raises:
            ValueError: wrong shape, or a value that is not finite.
            OutsideBoxError: outside the box by more than 1e-6 of its width.
        """
        array = np.array(p, dtype=np.float64, ndmin=2)
        if array.ndim != 2 or array.shape[1] != len(self.parameters):
            raise ValueError(
                f"{self.id}: expected parameters ({', '.join(self.parameters.names)}) of shape "
                f"(B, {len(self.parameters)}) or ({len(self.parameters)},), got {np.shape(p)}"
            )
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise ValueError(f"{self.id}: parameters must be finite; row {row} is {array[row]}")
        outside = ~self.parameters.contains(array, BOX_TOLERANCE)
        if outside.any() and not extrapolate:
            row = int(np.flatnonzero(outside)[0])
            raise OutsideBoxError(
                f"{self.id}: parameters {array[row]} (row {row}, {int(outside.sum())} of {len(array)} rows) lie "
                f"outside the box {self.parameters.lower} … {self.parameters.upper}; "
                "pass extrapolate=True to go on all the same"
            )
        return array

    def start(self, p: Array) -> tuple[Array, Array]:
        """Start states (B, nx) and contexts (B, nc) of parameters (B, np)."""
        in_state, slots, in_context = self._state_slots
        assert self.rest is not None
        states = np.tile(self.rest, (len(p), 1))
        states[:, slots] = p[:, in_state]
        return states, np.ascontiguousarray(p[:, in_context])

    def parameters_of(self, states: Array, contexts: Array) -> Array:
        """Parameters (B, np) of the problem that starts at ``states`` (B, nx) in ``contexts`` (B, nc)."""
        in_state, slots, in_context = self._state_slots
        p = np.empty((len(states), len(self.parameters)))
        p[:, in_state] = states[:, slots]
        p[:, in_context] = contexts
        return p

    def goal_error(self, states: Array) -> Array:
        """‖x − goal‖ of states (..., nx), periodic coordinates taken the short way round."""
        return np.asarray(np.linalg.norm(self.system.difference(states, self.goal.state), axis=-1))

    # -- expressions -----------------------------------------------------------------------------------------------

    def _namespaces(self, s: Any) -> tuple[SimpleNamespace, dict[str, Any]]:
        context = dict(zip(self.context.names, ca.vertsplit(s))) if len(self.context) else {}
        return SimpleNamespace(**context), {k: v for k, v in context.items() if k in self.system.constants}

    def rate(self, x: Any, u: Any, s: Any) -> Any:
        """(ẋ, L) stacked, (nx + 1, 1), as an expression in columns x, u, s."""
        context, replaced = self._namespaces(s)
        constants = SimpleNamespace(**{**self.system.constants, **replaced})
        cost = self.cost_rate(ca.vertsplit(x), ca.vertsplit(u), context, constants)
        return ca.vertcat(self.system.derivative(x, u, replaced), cost)

    def clearances(self, x: Any, s: Any) -> Any:
        """h(x, s), (nh, 1), as an expression; an empty column without path constraints."""
        if self.clearance is None:
            return type(x)(0, 1)
        context, replaced = self._namespaces(s)
        constants = SimpleNamespace(**{**self.system.constants, **replaced})
        return ca.vertcat(*self.clearance(ca.vertsplit(x), context, constants))

    def flow(self, x: Any, u: Any, s: Any, h: Any, substeps: int, disturbance: Any = 0) -> tuple[Any, Any]:
        """State after ``h`` seconds under constant u, and the cost of the step: the product's only Runge-Kutta map.

        ``disturbance`` (nx, 1) is added to ẋ.
        """

        def derivative(y: Any) -> Any:
            rate = self.rate(y[: self.system.nx], u, s)
            return rate + ca.vertcat(disturbance, 0) if not isinstance(disturbance, int) else rate

        y = rk4_step(derivative, ca.vertcat(x, 0), h, substeps)
        return y[: self.system.nx], y[self.system.nx]

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Fresh columns (x, u, s)."""
        sizes = (("x", self.system.nx), ("u", self.system.nu), ("s", len(self.context)))
        x, u, s = (ca.SX.sym(name, size) for name, size in sizes)
        return x, u, s

    # -- batched functions -----------------------------------------------------------------------------------------

    def batch_rate(self) -> BatchFunction:
        """(x, u, s) → (ẋ (B, nx), L (B, 1))."""
        x, u, s = self.symbols()
        rate = self.rate(x, u, s)
        return BatchFunction(dense_function("rate", [x, u, s], [rate[: self.system.nx], rate[self.system.nx]]))

    def batch_flow(self, substeps: int) -> BatchFunction:
        """(x, u, s, h (B, 1)) → (x⁺ (B, nx), cost (B, 1))."""
        x, u, s = self.symbols()
        h = ca.SX.sym("h")
        return BatchFunction(dense_function("flow", [x, u, s, h], list(self.flow(x, u, s, h, substeps))))

    def batch_linearisation(self, substeps: int) -> Callable[[Array, Array, Array, Array], tuple[Array, Array]]:
        """(x, u, s, h (B, 1)) → derivatives of the discrete step, A (B, nx, nx) and B (B, nx, nu)."""
        x, u, s = self.symbols()
        h = ca.SX.sym("h")
        following, _ = self.flow(x, u, s, h, substeps)
        jacobian = ca.jacobian(following, ca.vertcat(x, u))
        function = BatchFunction(dense_function("linearisation", [x, u, s, h], [jacobian]))

        def evaluate(x: Array, u: Array, s: Array, h: Array) -> tuple[Array, Array]:
            (both,) = function(x, u, s, h)
            return both[:, :, : self.system.nx], both[:, :, self.system.nx :]

        return evaluate

    def batch_clearances(self) -> BatchFunction:
        """(x, s) → h (B, nh)."""
        x, _, s = self.symbols()
        return BatchFunction(dense_function("clearances", [x, s], [self.clearances(x, s)]))

    def __deepcopy__(self, memo: dict[int, Any]) -> OptimalControlProblem:
        return self  # a value, and its functions could not be copied

    # -- variants and identity -------------------------------------------------------------------------------------

    def with_constants(self, **values: float) -> OptimalControlProblem:
        """The same problem on a system with other physical constants."""
        return dataclasses.replace(self, system=self.system.with_constants(**values)) if values else self

    @cached_property
    def fingerprint(self) -> str:
        """What a file must carry to belong to this problem: 16 hexadecimal digits.

        A hash of the boxes, the goal and the discretisation, and of the functions through their values at fixed points,
        rounded to six digits: equal for equal mathematics, whatever the version of CasADi wrote it down.
        """
        generator = np.random.Generator(np.random.Philox(key=20190622))
        x, u, s = (box.draw(generator, 16) for box in (self.system.state, self.system.control, self.context))
        values = [*self.batch_rate()(x, u, s)]
        if self.n_clearances:
            values += self.batch_clearances()(x, s)
        digits = [[f"{v:.6e}" for v in np.ravel(value)] for value in values]
        boxes = [
            [(c.name, c.lower, c.upper, c.period) for c in box.coordinates]
            for box in (self.system.state, self.system.control, self.parameters)
        ]
        goal = [self.goal.state.tolist(), self.goal.radius, self.goal.windings.tolist()]
        text = repr((self.id, boxes, goal, self.duration, self.knots, self.substeps, self.rest.tolist(), digits))  # type: ignore[union-attr]
        return hashlib.sha256(text.encode()).hexdigest()[:16]
