"""The goal of a problem, and the solution families into which its optimal trajectories fall."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeAlias

import casadi as ca
import numpy as np

from ocp_envs.support import fields
from ocp_envs.support.arrays import Array, Ints, frozen_array
from ocp_envs.support.doors import checked
from ocp_envs.system import Expression
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

#: (problem, parameters (B, np), B trajectories, multipliers of the clearances at the knots (B, N, nh)) → family of each
#: trajectory, (B,).
Classify = Callable[["OptimalControlProblem", Array, Trajectory, Array], Ints]
#: (context, constants), namespaces of expressions → list of expressions.
OfContext = Callable[[SimpleNamespace, SimpleNamespace], Sequence[Any]]
#: (state, context, constants) → list of expressions, one for each final constraint.
FinalConstraints = Callable[[Sequence[Expression], SimpleNamespace, SimpleNamespace], Sequence[Expression]]


@dataclass(frozen=True)
class Between:
    """The final values of a coordinate: at least ``lower`` and at most ``upper``, in its unit; ±inf for no bound.

    Both may be CasADi expressions where the goal is a function of the context.
    """

    lower: Expression = -np.inf
    upper: Expression = np.inf


#: A coordinate whose final value is free.
FREE = Between()
#: What a goal says of one coordinate: its value, or the values between which it ends.
Final: TypeAlias = Any


def sides(what: str, row: Sequence[Final], names: Sequence[str]) -> tuple[list[Expression], list[Expression]]:
    """Lower and upper sides of the final values in ``row``, one for each of the coordinates ``names``.

    ``what`` they are is for messages.

    Raises:
        ValueError: another number of values, one that is no number or expression, or sides in the wrong order.
    """
    if len(row) != len(names):
        raise ValueError(f"{what} must have a final value for each of {list(names)}, got {len(row)}")
    lower, upper = [], []
    for name, value in zip(names, row):
        low, high = (value.lower, value.upper) if isinstance(value, Between) else (value, value)
        for side in (low, high):
            if not isinstance(side, numbers.Real | np.ndarray | ca.SX | ca.DM) or isinstance(side, bool):
                raise ValueError(f"{what}: {name} must be a number, Between or FREE, got {value!r}")
        numeric = isinstance(low, numbers.Real) and isinstance(high, numbers.Real)
        if numeric and not (low <= high and (low < high or np.isfinite(float(low)))):
            raise ValueError(f"{what}: expected lower ≤ upper for {name}, got {value!r}")
        lower.append(low)
        upper.append(high)
    return lower, upper


@dataclass(frozen=True, eq=False)
class Goal:
    """Where trajectories end, and the goal ball around it, see :mod:`ocp_envs.terminal`.

    Args:
        state: a final value for each coordinate, (nx,), in the unit of that coordinate: a number, :class:`Between` two
            numbers, or :data:`FREE`. A sequence of several such states declares alternatives, each of which is a goal.
            A function (context, constants) → either of these declares a goal that depends on the instance.
        radius: of the goal ball, ‖(x − state) / tolerance‖ < radius, where only the part outside :class:`Between`
            counts, and the shortest difference in periodic coordinates.
        windings: whole turns added to the periodic coordinates of the goal, (W, nx); the solver tries each row; by
            default none.
        control: control that keeps the system at the goal, (nu,), by default 0, or a function (context, constants) →
            list of nu expressions. Initial guesses and control scales are centred on it.
        tolerance: one length for each coordinate, in its unit, (nx,), by default 1.
        inequalities, equalities: final constraints, functions (state, context, constants) → list of expressions that
            are ≥ 0, or 0, at the end. In the goal ball their violations count as distances divided by a tolerance do.

    Raises:
        TypeError: an argument of another type.
        ValueError: a state or control that is not finite, a radius or tolerance that is not positive and finite, or
            windings that are not whole, twice the same, or none.
    """

    state: Any
    radius: float = 1.0
    windings: Any = None
    control: Any = None
    tolerance: Any = None
    inequalities: FinalConstraints | None = None
    equalities: FinalConstraints | None = None

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        if not callable(self.state) and not _has_ranges(self.state):
            put("state", fields.vector("goal", "state", self.state))
        put("radius", fields.positive("goal", "radius", self.radius))
        if self.windings is not None:
            put("windings", fields.whole_rows("goal", "windings", self.windings))
        if self.control is not None and not callable(self.control):
            put("control", fields.vector("goal", "control", self.control))
        if self.tolerance is not None:
            tolerance = fields.vector("goal", "tolerance", self.tolerance)
            put("tolerance", tolerance)
            if (tolerance <= 0).any():
                raise ValueError(f"goal: tolerance must be positive, got {tolerance}")
        for name in ("inequalities", "equalities"):
            if getattr(self, name) is not None:
                fields.function("goal", name, getattr(self, name))

    def __repr__(self) -> str:
        windings = 1 if self.windings is None else len(self.windings)
        return f"Goal({_text(self.state)}, radius={self.radius:g}, {windings} windings, control={_text(self.control)})"

    def windings_of(self, nx: int) -> Ints:
        """Whole turns of each winding of ``nx`` coordinates, (V, nx)."""
        return frozen_array(np.zeros((1, nx)), np.int64) if self.windings is None else self.windings

    def tolerance_of(self, nx: int) -> Array:
        """The tolerance of each of ``nx`` coordinates, (nx,)."""
        return frozen_array(np.ones(nx)) if self.tolerance is None else self.tolerance

    @staticmethod
    def alternatives_of(declared: Sequence[Any]) -> Sequence[Sequence[Final]]:
        """The alternatives in a ``declared`` state, one row of final values each."""
        nested = all(isinstance(row, Sequence | np.ndarray) and not isinstance(row, str) for row in declared)
        return declared if nested and len(declared) else [declared]


def _has_ranges(state: object) -> bool:
    """Whether a declared ``state`` has alternatives, or coordinates that are not fixed."""
    if not isinstance(state, Sequence) or isinstance(state, str):
        return False
    return any(isinstance(value, Between | Sequence) and not isinstance(value, str) for value in state)


def _text(values: object) -> str:
    if callable(values):
        return "a function of the context"
    if isinstance(values, np.ndarray):
        return "[" + ", ".join(f"{value:.4g}" for value in values) + "]"
    return repr(values)


@dataclass(frozen=True, eq=False)
class Modes:
    """The families into which the optimal trajectories of a problem fall.

    Args:
        names: one name for each family.
        classify: assigns trajectories to families, see :data:`Classify`; :meth:`of` calls it.

    Raises:
        TypeError: an argument of another type.
        ValueError: no names, or a name that occurs twice.
    """

    names: tuple[str, ...]
    classify: Classify

    def __post_init__(self) -> None:
        if isinstance(self.names, str) or not isinstance(self.names, Sequence):
            raise TypeError(f"modes: names must be a tuple of texts, got {self.names!r}")
        object.__setattr__(self, "names", tuple(fields.words("modes", "each of names", name) for name in self.names))
        if not self.names or len(set(self.names)) < len(self.names):
            raise ValueError(f"modes: names must be at least one, and no two the same, got {list(self.names)}")
        fields.function("modes", "classify", self.classify)

    def __len__(self) -> int:
        return len(self.names)

    def of(self, problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array) -> Ints:
        """The family of each of B trajectories, an index into ``names``, (B,).

        Args:
            problem: the problem.
            parameters: of its instances, (B, np).
            trajectory: B trajectories.
            multipliers: those of the clearances at the knots, (B, N, nh).

        Raises:
            ValueError: ``classify`` returns another shape, no whole numbers, or an index that no name has.
        """
        family = np.asarray(self.classify(problem, parameters, trajectory, multipliers))
        if family.shape != (len(trajectory),) or not np.issubdtype(family.dtype, np.integer):
            raise ValueError(
                f"{problem.id}: modes.classify must return a whole number for each of {len(trajectory)} trajectories, "
                f"got the shape {family.shape} of {family.dtype}"
            )
        if wrong := sorted({int(i) for i in family if not 0 <= i < len(self)}):
            raise ValueError(
                f"{problem.id}: modes.classify returned {wrong}, but modes.names has {len(self)} families, 0 … "
                f"{len(self) - 1}: {list(self.names)}"
            )
        return family.astype(np.int64)


def _all_in_one(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array) -> Ints:
    return np.zeros(len(trajectory), dtype=np.int64)


SINGLE_MODE = Modes(("all",), _all_in_one)


@checked
def winding_modes(names: Sequence[str]) -> Modes:
    """One family for each winding of the goal: that of the target nearest to the final state.

    Args:
        names: one for each row of ``goal.windings``; a problem with another number of windings is refused.
    """
    names = tuple(names)
    return Modes(names, _NearestTarget(names))


@dataclass(frozen=True)
class _NearestTarget:
    """Assigns trajectories to the nearest target; ``names`` are those of the targets."""

    names: tuple[str, ...]

    def __call__(
        self, problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array
    ) -> Ints:
        """The family of each trajectory, see :data:`Classify`."""
        if len(self.names) != len(problem.terminal):
            raise ValueError(
                f"{problem.id}: winding_modes needs a name for each of the {len(problem.terminal)} rows of "
                f"goal.windings, got {len(self.names)}: {list(self.names)}"
            )
        ends = trajectory.states[:, -1]
        nearest = problem.terminal.nearest(ends, problem.start(parameters)[1])
        distance = np.abs(ends[:, None] - nearest).sum(axis=-1)
        return np.asarray(distance.argmin(axis=1), dtype=np.int64)
