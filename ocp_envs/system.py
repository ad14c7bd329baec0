"""Controlled dynamical systems, declared once as CasADi expressions.

A system is ẋ = f(x, u, c): state x, control u and physical constants c. Every coordinate carries its unit,
its operating box, its typical size and, for an angle, its period. Time is discretised by the classical Runge-Kutta
scheme of order four (Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, II.1) with the
control held over the step:

    k1 = f(x),  k2 = f(x + h/2 k1),  k3 = f(x + h/2 k2),  k4 = f(x + h k3),  x⁺ = x + h/6 (k1 + 2 k2 + 2 k3 + k4)
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType, SimpleNamespace
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.expressions import Names, called, column
from ocp_envs.support import fields
from ocp_envs.support.arrays import Array, frozen_array

#: A CasADi expression, SX, MX or DM, or a NumPy array where a declaration is evaluated on numbers. CasADi has no type
#: stubs.
Expression: TypeAlias = Any
#: f(state, control, constants): sequences of scalar expressions and a namespace of constants → list of ẋ.
Dynamics = Callable[[Sequence[Expression], Sequence[Expression], SimpleNamespace], Sequence[Expression]]


def wrap(difference: Expression, period: float) -> Expression:
    """``difference`` (NumPy array or CasADi expression) shifted by whole periods into [-period/2, period/2)."""
    floor = ca.floor if isinstance(difference, (ca.SX, ca.MX)) else np.floor
    return difference - period * floor(difference / period + 0.5)


def rk4_step(
    derivative: Callable[[Expression], Expression], x: Expression, h: Expression, substeps: int = 1
) -> Expression:
    """The Runge-Kutta map of order four, for numbers and CasADi expressions.

    Args:
        derivative: x → ẋ.
        x: the state.
        h: length of the whole step, seconds.
        substeps: number of equal Runge-Kutta steps in it.

    Returns:
        the state after ``h`` seconds.
    """
    h = h / substeps
    for _ in range(substeps):
        k1 = derivative(x)
        k2 = derivative(x + h / 2 * k1)
        k3 = derivative(x + h / 2 * k2)
        k4 = derivative(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


@dataclass(frozen=True)
class Coordinate:
    """One component of a state, a control, a context or a parameter.

    Args:
        name: identifier, unique within its vector.
        lower, upper: finite bounds of the operating box, in ``unit``.
        unit: SI unit as text; ``"1"`` where there is none.
        scale: typical size, in ``unit``; the optimiser sees the coordinate divided by it.
        period: length of one turn of a periodic coordinate, else ``None``.

    Raises:
        TypeError: an argument of another type.
        ValueError: a name that is no identifier, bounds that are not finite or not in order, or a scale or period that
            is not positive and finite.
    """

    name: str
    lower: float
    upper: float
    unit: str = "1"
    scale: float = 1.0
    period: float | None = None

    def __post_init__(self) -> None:
        fields.identifier("coordinate", "name", self.name)
        owner = f"coordinate {self.name!r}"
        lower, upper = (fields.finite(owner, name, getattr(self, name)) for name in ("lower", "upper"))
        if not lower < upper:
            raise ValueError(f"{owner}: expected finite lower < upper, got [{self.lower}, {self.upper}]")
        fields.instance(owner, "unit", self.unit, str)
        fields.positive(owner, "scale", self.scale)
        if self.period is not None:
            fields.positive(owner, "period", self.period)


@dataclass(frozen=True)
class Box:
    """The box spanned by ``coordinates``: ``lower``, ``upper``, ``width`` and ``centre`` of shape (n,).

    Raises:
        TypeError: something else than a sequence of coordinates.
        ValueError: a name that occurs twice.
    """

    coordinates: tuple[Coordinate, ...]

    def __post_init__(self) -> None:
        if isinstance(self.coordinates, str) or not isinstance(self.coordinates, Sequence):
            raise TypeError(f"box: coordinates must be a tuple of Coordinate, got {self.coordinates!r}")
        object.__setattr__(self, "coordinates", tuple(self.coordinates))
        for coordinate in self.coordinates:
            fields.instance("box", "each of coordinates", coordinate, Coordinate)
        names = [c.name for c in self.coordinates]
        if len(set(names)) != len(names):
            raise ValueError(f"coordinate names must be unique, got {names}")

    def __len__(self) -> int:
        return len(self.coordinates)

    def __repr__(self) -> str:
        return f"Box({', '.join(f'{c.name} [{c.lower:g}, {c.upper:g}] {c.unit}' for c in self.coordinates)})"

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.coordinates)

    @cached_property
    def lower(self) -> Array:
        return frozen_array([c.lower for c in self.coordinates])

    @cached_property
    def upper(self) -> Array:
        return frozen_array([c.upper for c in self.coordinates])

    @cached_property
    def width(self) -> Array:
        return frozen_array(self.upper - self.lower)

    @cached_property
    def centre(self) -> Array:
        return frozen_array((self.upper + self.lower) / 2)

    @cached_property
    def scale(self) -> Array:
        return frozen_array([c.scale for c in self.coordinates])

    @cached_property
    def periods(self) -> Array:
        """Periods, 0 where the coordinate does not repeat; shape (n,)."""
        return frozen_array([c.period or 0.0 for c in self.coordinates])

    def narrowed(self, sides: Mapping[str, tuple[float, float]]) -> Box:
        """This box with the bounds ``sides``, (lower, upper) by the name of the coordinate; without any, this box.

        Raises:
            ValueError: a name that is none of its coordinates, or bounds that are not in order or not inside.
        """
        if not sides:
            return self
        for name, (lower, upper) in sides.items():
            c = self.coordinates[self.names.index(name)] if name in self.names else None
            if c is None or not c.lower <= lower < upper <= c.upper:
                within = "" if c is None else f" within [{c.lower:g}, {c.upper:g}] {c.unit}"
                raise ValueError(
                    f"expected lower < upper{within} of one of {list(self.names)}, got {name} = {lower, upper}"
                )
        return Box(
            tuple(
                dataclasses.replace(c, lower=float(sides[c.name][0]), upper=float(sides[c.name][1]))
                if c.name in sides
                else c
                for c in self.coordinates
            )
        )

    def contains(self, values: Array, tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Whether each row of ``values`` (..., n) is in the box widened by ``tolerance`` × its width (NaN never is)."""
        margin = tolerance * self.width
        inside = (values >= self.lower - margin) & (values <= self.upper + margin)
        return np.asarray(inside.all(axis=-1))

    def draw(self, rng: np.random.Generator, n: int) -> Array:
        """``n`` points uniform in the box, (n, len), drawn from ``rng`` row by row."""
        return self.lower + rng.random((n, len(self))) * self.width


def inside(owner: str, what: str, values: Array, box: Box) -> None:
    """Refuse ``values`` (n,) outside ``box``.

    Args:
        owner: the id of the problem, for messages.
        what: what the values are, for messages.
        values: (n,).
        box: where they have to lie; bounds may be exceeded by rounding, 1e-9 of the width.

    Raises:
        ValueError: outside; the message names the coordinate.
    """
    margin = 1e-9 * box.width
    outside = np.flatnonzero((values < box.lower - margin) | (values > box.upper + margin))
    if len(outside):
        c = box.coordinates[outside[0]]
        raise ValueError(
            f"{owner}: {what} has {c.name} = {values[outside[0]]:g}, outside its operating box "
            f"[{c.lower:g}, {c.upper:g}] {c.unit}; move it, or widen the box of the system"
        )


@dataclass(frozen=True, eq=False)
class System:
    """ẋ = f(x, u, c) with its coordinates and the nominal values of its constants.

    Args:
        name: what the system is called.
        state: coordinates of x.
        control: coordinates of u.
        constants: nominal value of every physical constant, by name. The dynamics see symbols, so another mass is
            another value of the same declaration (:meth:`with_constants`), not another function.
        dynamics: f, called with sequences of scalars and a namespace of constants; returns the nx components of ẋ.

    Raises:
        TypeError: an argument of another type.
        ValueError: a box without coordinates, a constant that is not finite or has no name of its own, or dynamics
            that fail, return NaN or another number of components.
    """

    name: str
    state: Box
    control: Box
    constants: Mapping[str, float]
    dynamics: Dynamics

    def __post_init__(self) -> None:
        fields.words("system", "name", self.name)
        for role in ("state", "control"):
            if not len(fields.instance(self.name, role, getattr(self, role), Box)):
                raise ValueError(f"{self.name}: {role} must have at least one coordinate")
        fields.function(self.name, "dynamics", self.dynamics)
        fields.instance(self.name, "constants", self.constants, Mapping)  # type: ignore[type-abstract]
        constants = {name: fields.finite(self.name, f"constant {name!r}", v) for name, v in self.constants.items()}
        for name in constants:
            fields.identifier(self.name, "the name of a constant", name)
            if name in self.state.names:
                raise ValueError(
                    f"{self.name}: constant {name!r} has the name of a state coordinate; rename one of them"
                )
        object.__setattr__(self, "constants", MappingProxyType(constants))
        self._check_rate(self.derivative(ca.SX.sym("x", self.nx), ca.SX.sym("u", self.nu), {}))

    def _check_rate(self, rate: Expression) -> None:
        """Refuse ẋ with a component that is the number NaN, whatever state and control are."""
        for name, component in zip(self.state.names, ca.vertsplit(ca.SX(rate))):
            if component.is_constant() and math.isnan(float(component)):
                raise ValueError(
                    f"{self.name}: dynamics returns nan as the derivative of {name!r}; use CasADi's functions, such as "
                    "ca.sin, instead of those of math, which turn a symbol into nan"
                )

    def __reduce__(self) -> tuple[object, ...]:
        # A read-only mapping does not pickle; functions travel by reference, or by value with cloudpickle.
        return System, (self.name, self.state, self.control, dict(self.constants), self.dynamics)

    def __repr__(self) -> str:
        constants = ", ".join(f"{name}={value:g}" for name, value in self.constants.items())
        return f"System({self.name!r}, nx={self.nx}, nu={self.nu}, {constants})"

    @property
    def nx(self) -> int:
        return len(self.state)

    @property
    def nu(self) -> int:
        return len(self.control)

    def derivative(self, x: Expression, u: Expression, constants: Mapping[str, Expression]) -> Expression:
        """ẋ (nx, 1) as an expression in columns ``x`` and ``u``; ``constants`` replace nominal values by name."""
        return self.derivative_of(x, u, Names("constant", {**self.constants, **constants}))

    def derivative_of(self, x: Expression, u: Expression, constants: Names) -> Expression:
        """ẋ (nx, 1) as an expression in columns ``x`` and ``u`` with all ``constants``.

        Raises:
            ValueError: dynamics that fail, or do not return one expression for each state coordinate.
        """
        what = f"{self.name}: dynamics"
        values = called(what, "state, control, constants", self.dynamics, ca.vertsplit(x), ca.vertsplit(u), constants)
        return column(what, values, self.state.names)

    def with_constants(self, **values: float) -> System:
        """The same system with other physical constants in SI units, for instance ``with_constants(mass=0.6)``.

        Raises:
            ValueError: a name the system does not have.
        """
        unknown = sorted(set(values) - set(self.constants))
        if unknown:
            raise ValueError(f"{self.name} has no constant {unknown}; its constants are {sorted(self.constants)}")
        return dataclasses.replace(self, constants={**self.constants, **values})

    def difference(self, a: Expression, b: Expression) -> Expression:
        """a − b, with the shortest difference in periodic coordinates: the only place where angles are wrapped.

        Args:
            a, b: arrays (..., nx), or CasADi columns (nx, 1).
        """
        if isinstance(a, (ca.SX, ca.MX)) or isinstance(b, (ca.SX, ca.MX)):
            columns = zip(ca.vertsplit(a - b), self.state.coordinates)
            return ca.vertcat(*[wrap(d, c.period) if c.period else d for d, c in columns])
        delta = np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)
        for i, coordinate in enumerate(self.state.coordinates):
            if coordinate.period is not None:
                delta[..., i] = wrap(delta[..., i], coordinate.period)
        return delta
