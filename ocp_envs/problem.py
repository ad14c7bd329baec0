"""A parametric optimal control problem, declared once; everything else is derived from this value.

    minimise    φ(x(t_f), s, c) + ∫_0^{t_f} L(x, u, s, c) dt      over u(·) and t_f
    subject to  ẋ = f(x, u, c),   x(0) = x_0,   x(t_f) in the goal (modulo whole turns),
                x, u in their boxes,   t_f in its bounds,
                h(x, s, c) ≥ 0,   g(x, u, s, c) ≥ 0,   e(x, u, s, c) = 0

The parameter p of a problem instance stands for its initial state x_0 and its *context* s, which is constant over an
episode: ``start(p) → (x_0, s)`` and ``parameters_of(x_0, s) → p`` are inverses (:mod:`ocp_envs.parameters`). A context
coordinate with the name of a physical constant replaces that constant.

Time is a state where f, L or a constraint depends on it: a coordinate whose derivative is 1, which begins at 0 and
whose final value is free. Likewise the integral of a constraint is a state with a bound on its final value.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import casadi as ca
import cloudpickle
from numpy.typing import ArrayLike

from ocp_envs import trial
from ocp_envs.declaration import check_parts, checked_fields
from ocp_envs.distribution import UNIFORM, Distribution
from ocp_envs.fingerprint import fingerprint
from ocp_envs.formulation import Formulation
from ocp_envs.functions import BatchFunctions
from ocp_envs.goal import SINGLE_MODE, Goal, Modes, OfContext
from ocp_envs.horizon import Horizon
from ocp_envs.parameters import Parametrisation
from ocp_envs.picture import Picture
from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, Coordinate, Expression, System
from ocp_envs.terminal import TerminalSet
from ocp_envs.trajectory import Trajectory, flat_size

#: (state, control, context, constants) → L, one expression; context and constants are namespaces.
CostRate = Callable[[Sequence[Expression], Sequence[Expression], SimpleNamespace, SimpleNamespace], Expression]
#: (state, context, constants) → list of expressions that must stay ≥ 0, in metres where they are distances.
Clearance = Callable[[Sequence[Expression], SimpleNamespace, SimpleNamespace], Sequence[Expression]]
#: (state, control, context, constants) → list of expressions.
MixedConstraints = Callable[
    [Sequence[Expression], Sequence[Expression], SimpleNamespace, SimpleNamespace], Sequence[Expression]
]
#: (state, context, constants) → φ, one expression.
TerminalCost = Callable[[Sequence[Expression], SimpleNamespace, SimpleNamespace], Expression]
#: (context, constants) → one expression.
Bound = Callable[[SimpleNamespace, SimpleNamespace], Expression]


@dataclass(frozen=True, eq=False)
class OptimalControlProblem:
    """One problem of the benchmark, or of the user.

    Args:
        id: name of the environment, such as ``"PendulumSwingup-v0"``.
        title: the task in half a line, such as "swing a pendulum up".
        system: the controlled system.
        parameters: box of p.
        cost_rate: L, see :data:`CostRate`, or ``None`` where there is only a terminal cost.
        goal: where trajectories end.
        duration: bounds of t_f, seconds, each a number or a function (context, constants) → one expression; equal
            numbers, or twice the same function, fix it.
        knots: N, the number of knots of a trajectory, at least 2.
        substeps: Runge-Kutta steps in one interval between knots of the nonlinear program, at least 1.
        hold: seconds of terminal regulation before success is evaluated; 0 where the goal is not stabilisable.
        time_limit: seconds after which an episode of the environment is truncated, at least the longest duration.
        rest: initial values of the state coordinates that p does not name, (nx,), by default those of the goal; or a
            function (context, constants) → list of nx expressions.
        clearance: h, see :data:`Clearance`, or ``None`` for no constraint on the path.
        modes: families of optimal trajectories; by default a single one.
        picture: how to draw the problem, or ``None``: plots over time only.
        distribution: of p; by default uniform over its box.
        longest_substep: maximum length of a Runge-Kutta step of the simulation, seconds.
        symmetry: a map under which the problem is invariant, or ``None``.
        terminal_cost: φ, see :data:`TerminalCost`, or ``None``.
        inequalities, equalities: g and e, see :data:`MixedConstraints`, or ``None``. Plans meet them at every knot with
            the control of the interval that begins there.
        clearance_points: points of each interval at which plans keep h ≥ 0: with 1 these are the knots, with m there
            are m − 1 more between two knots, equally spaced in time.
        planned: (lower, upper) of states and controls in plans, by the name of the coordinate, where plans have to keep
            a distance from the bounds of the system, at which a simulation ends and a control is clipped.

    Raises:
        TypeError: an argument of another type.
        ValueError: an argument out of its range, parts that do not fit together, or functions that fail or are not
            finite at a few points that are tried; the message names them, and says what to do.

    Warns:
        UserWarning: constants that nothing reads, functions that are not finite in a part of the box, or a goal that is
            an equilibrium only in some contexts.
    """

    id: str
    title: str
    system: System
    parameters: Box
    cost_rate: CostRate | None
    goal: Goal
    duration: tuple[float | Bound, float | Bound]
    knots: int
    substeps: int
    hold: float
    time_limit: float
    rest: Array | OfContext | None = None
    clearance: Clearance | None = None
    modes: Modes = SINGLE_MODE
    picture: Picture | None = None
    distribution: Distribution = UNIFORM
    longest_substep: float = 0.02
    symmetry: Symmetry | None = None
    terminal_cost: TerminalCost | None = None
    inequalities: MixedConstraints | None = None
    equalities: MixedConstraints | None = None
    planned: Mapping[str, tuple[float, float]] | None = None
    clearance_points: int = 1

    def __post_init__(self) -> None:
        self.__dict__.update(checked_fields(self))
        check_parts(self)
        trial.check(self)

    def __reduce__(self) -> tuple[object, ...]:
        # Without what was derived and kept; what was checked when it was made is not checked again.
        # Functions travel by reference or, if they have no name, by value.
        return _restored, (cloudpickle.dumps(self._fields()),)

    def __repr__(self) -> str:
        sizes = f"nx={self.system.nx}, nu={self.system.nu}, np={len(self.parameters)}, nh={self.n_clearances}"
        shortest, longest = (f"{t:g}" if isinstance(t, float) else "f(s)" for t in self.duration)
        return (
            f"OptimalControlProblem({self.id!r}, {sizes}, knots={self.knots}, t_f {shortest} … {longest} s,\n"
            f"  p in {self.parameters!r},\n"
            f"  families {' | '.join(self.modes.names)})"
        )

    def _fields(self) -> dict[str, object]:
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    @property
    def flat_size(self) -> int:
        """Length of a flat trajectory."""
        return flat_size(self.knots, self.system.nx, self.system.nu)

    def unflatten(self, z: ArrayLike) -> Trajectory:
        """Trajectories of the flat layout ``z``, (B, flat_size) or (flat_size,); ``ValueError`` for other lengths."""
        return Trajectory.from_flat(z, self.knots, self.system.nx, self.system.nu)

    @cached_property
    def terminal(self) -> TerminalSet:
        """The goal, evaluated for the instances of the problem."""
        return TerminalSet(self)

    @cached_property
    def targets(self) -> Array:
        """A state of each target of the goal in the central context, (W, nx); see :mod:`ocp_envs.terminal`."""
        centre = self.context.centre[None]
        return frozen_array(self.terminal.nearest(self.terminal.states(centre), centre)[0])

    @cached_property
    def planned_states(self) -> Box:
        """The box of states in plans."""
        return self._planned(self.system.state)

    @cached_property
    def planned_controls(self) -> Box:
        """The box of controls in plans."""
        return self._planned(self.system.control)

    def _planned(self, box: Box) -> Box:
        return box.narrowed({name: sides for name, sides in (self.planned or {}).items() if name in box.names})

    @cached_property
    def horizon(self) -> Horizon:
        """The durations of its trajectories."""
        return Horizon(self)

    @cached_property
    def n_clearances(self) -> int:
        """Number of path constraints, nh."""
        x, _, s = self.symbols()
        return int(self.clearances(x, s).shape[0])

    @cached_property
    def parametrisation(self) -> Parametrisation:
        """The map between p and (x_0, s)."""
        rest: Array | OfContext = self.goal.state if self.rest is None else self.rest
        return Parametrisation(
            self.id, self.parameters, self.system.state, self.functions.rest_at if callable(rest) else rest
        )

    @property
    def context(self) -> Box:
        """Coordinates of s: those of p that are not state coordinates."""
        return self.parametrisation.context

    def check_parameters(self, p: ArrayLike, extrapolate: bool = False) -> Array:
        """``p`` as a float64 array (B, np).

        Args:
            p: (B, np) or (np,).
            extrapolate: accept parameters outside the box (never non-finite ones).

        Raises:
            ValueError: wrong shape, or a value that is not finite.
            OutsideBoxError: outside the box by more than 1e-6 of its width, also after whole turns of angles.
        """
        return self.parametrisation.check(p, extrapolate)

    def in_one_turn(self, p: ArrayLike) -> tuple[Array, Array]:
        """Parameters ``p`` (B, np) or (np,), in the box or not, with their angles written in one turn.

        Returns:
            the parameters (B, np) whose angles are in the turn around the centre of the box, not changed by a bit where
            they were there already; and the whole turns (B, nx) that lead from their initial states to those of ``p``.

        Raises:
            ValueError: wrong shape, or a value that is not finite.
        """
        return self.parametrisation.in_one_turn(self.check_parameters(p, extrapolate=True))

    def start(self, p: Array) -> tuple[Array, Array]:
        """Initial states (B, nx) and contexts (B, nc) of parameters ``p`` (B, np)."""
        return self.parametrisation.start(p)

    def parameters_of(self, states: Array, contexts: Array) -> Array:
        """Parameters (B, np) with the initial states ``states`` (B, nx) and the contexts ``contexts`` (B, nc)."""
        return self.parametrisation.parameters_of(states, contexts)

    def goal_error(self, states: Array, contexts: Array | None = None) -> Array:
        """The distance of ``states`` (..., nx) from the goal in ``contexts`` (..., nc), (...): ‖x − goal‖.

        Periodic coordinates have the shortest difference; of a goal that is no single state the distance is that of
        :mod:`ocp_envs.terminal`. Without contexts the goal is that of the central one.
        """
        return self.terminal.error(states, self.context.centre if contexts is None else contexts)

    @cached_property
    def formulation(self) -> Formulation:
        """The functions of the problem as CasADi expressions."""
        return Formulation(self)

    @cached_property
    def functions(self) -> BatchFunctions:
        """The functions of the problem on arrays."""
        return BatchFunctions(self)

    def rate(self, x: Expression, u: Expression, s: Expression) -> Expression:
        """(ẋ, L) as one expression, (nx + 1, 1), in columns ``x`` (nx, 1), ``u`` (nu, 1) and ``s`` (nc, 1).

        Raises:
            ValueError: dynamics or a cost rate that fail, or return something else.
        """
        return self.formulation.rate(x, u, s)

    def clearances(self, x: Expression, s: Expression) -> Expression:
        """h, (nh, 1), as an expression in columns ``x`` (nx, 1) and ``s`` (nc, 1); empty without path constraints.

        Raises:
            ValueError: a clearance that fails, or returns something else than a list of expressions.
        """
        return self.formulation.clearances(x, s)

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Fresh columns (x, u, s)."""
        sizes = (("x", self.system.nx), ("u", self.system.nu), ("s", len(self.context)))
        x, u, s = (ca.SX.sym(name, size) for name, size in sizes)
        return x, u, s

    @cached_property
    def n_mixed(self) -> tuple[int, int]:
        """Number of constraints on states and controls, those ≥ 0 and those = 0."""
        inequalities, equalities = self.formulation.mixed(*self.symbols())
        return int(inequalities.shape[0]), int(equalities.shape[0])

    @cached_property
    def constrained(self) -> bool:
        """Whether there are constraints on the path."""
        return bool(self.n_clearances or sum(self.n_mixed))

    @property
    def n_between(self) -> int:
        """Number of path constraints between two knots."""
        return self.n_clearances * (self.clearance_points - 1)

    def __deepcopy__(self, memo: dict[int, object]) -> OptimalControlProblem:
        return self  # a value, and its functions could not be copied

    def with_constants(self, **values: float) -> OptimalControlProblem:
        """The same problem with other values of physical constants, by name, in SI units: a plant, which may differ.

        Raises:
            ValueError: a name the system does not have, a constant that is a parameter, or values with which the
                functions are not finite.
        """
        if given := [name for name in values if name in self.context.names]:
            raise ValueError(
                f"{self.id}: the constants {given} are parameters of this problem, whose values come with each "
                "instance, so others would be ignored; give them with the parameters of the instance"
            )
        if not values:
            return self
        plant = _of_checked({**self._fields(), "system": self.system.with_constants(**values)})
        trial.check(plant, nominal=False)
        return plant

    @cached_property
    def from_any_state(self) -> OptimalControlProblem:
        """The same problem from any state in the operating box: its parameter is [x_0; s].

        The rest of a trajectory is a trajectory of it. Angles are written in the same turn, from which the windings of
        the goal count.
        """
        parameters = self.parametrisation.whole_state()
        return _of_checked({**self._fields(), "parameters": parameters, "distribution": UNIFORM})

    def with_varied(self, **sides: Sequence[float]) -> OptimalControlProblem:
        """The same problem with physical constants as further parameters, after its own: a plant for a batch.

        Args:
            sides: the smallest and the largest value of each, by name, in SI units.

        Raises:
            ValueError: a name the system does not have, or a constant that is a parameter already.
        """
        if not sides:
            return self
        self.with_constants(**{name: float(low) for name, (low, _) in sides.items()})  # refuses such names
        more = tuple(
            Coordinate(name, float(low) - 1e-9 * (1 + abs(low)), float(high) + 1e-9 * (1 + abs(high)))
            for name, (low, high) in sides.items()
        )
        parameters = Box((*self.parameters.coordinates, *more))
        return _of_checked({**self._fields(), "parameters": parameters, "distribution": UNIFORM})

    @cached_property
    def fingerprint(self) -> str:
        """What a file must carry to belong to this problem."""
        return fingerprint(self)


def _restored(fields: bytes) -> OptimalControlProblem:
    return _of_checked(cloudpickle.loads(fields))


def _of_checked(fields: dict[str, object]) -> OptimalControlProblem:
    problem = object.__new__(OptimalControlProblem)
    problem.__dict__.update(fields)
    return problem
