"""The parameter p of a problem, and the initial state and context that it stands for.

A component of p that carries the name of a state coordinate is the initial value of that coordinate. Every other
component belongs to the *context* s, which is constant over an episode. State coordinates that p does not name begin at
a fixed value.

An angle that is increased by a whole turn is another way of writing the same initial state. :meth:`in_one_turn
<Parametrisation.in_one_turn>` chooses one of them, in the turn around the centre of the parameter box; where the box
covers a whole turn, its ends are the same state, which is written as the lower one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.doors import checked
from ocp_envs.system import Box, Coordinate

BOX_TOLERANCE = 1e-6
#: The turn around the centre ends by this fraction of a turn before its upper end, so that rounding does not decide by
#: which end a state there is written.
SEAM = 1e-9


class OutsideBoxError(ValueError):
    """A parameter lies outside the parameter box."""


@checked
@dataclass(frozen=True, eq=False)
class Parametrisation:
    """The map between p and (x_0, s).

    Args:
        owner: the id of the problem, for messages.
        box: of p.
        states: the box of x, for the names and the periods of its coordinates.
        rest: initial values of the state coordinates that p does not name, (nx,), or those (B, nx) as a function of the
            contexts (B, nc).
    """

    owner: str
    box: Box
    states: Box
    rest: Array | Callable[[Array], Array]

    @cached_property
    def context(self) -> Box:
        """Coordinates of s."""
        return Box(tuple(c for c in self.box.coordinates if c.name not in self.states.names))

    @cached_property
    def slots(self) -> tuple[Ints, Ints, Ints]:
        """Components of p that are initial values, the state coordinates they belong to, and components of s."""
        names = self.states.names
        in_state = [i for i, name in enumerate(self.box.names) if name in names]
        slots = [names.index(self.box.names[i]) for i in in_state]
        in_context = [i for i, name in enumerate(self.box.names) if name not in names]
        return np.array(in_state, np.int64), np.array(slots, np.int64), np.array(in_context, np.int64)

    def start(self, p: Array) -> tuple[Array, Array]:
        """Initial states (B, nx) and contexts (B, nc) of parameters ``p`` (B, np)."""
        in_state, slots, in_context = self.slots
        contexts = np.ascontiguousarray(p[:, in_context])
        states = np.array(self.rest(contexts)) if callable(self.rest) else np.tile(self.rest, (len(p), 1))
        states[:, slots] = p[:, in_state]
        return states, contexts

    def parameters_of(self, states: Array, contexts: Array) -> Array:
        """Parameters (B, np) with the initial states ``states`` (B, nx) and the contexts ``contexts`` (B, nc)."""
        in_state, slots, in_context = self.slots
        p = np.empty((len(states), len(self.box)))
        p[:, in_state] = states[:, slots]
        p[:, in_context] = contexts
        return p

    def whole_state(self) -> Box:
        """The box of [x_0; s]: all states, an angle in one turn around the centre of its box here, and the contexts."""
        here = dict(zip(self.box.names, self.box.centre))

        def one_turn(coordinate: Coordinate) -> Coordinate:
            if coordinate.period is None:
                return coordinate
            centre = here.get(coordinate.name, (coordinate.lower + coordinate.upper) / 2)
            half = coordinate.period / 2
            return dataclasses.replace(coordinate, lower=float(centre - half), upper=float(centre + half))

        return Box((*map(one_turn, self.states.coordinates), *self.context.coordinates))

    @cached_property
    def turn(self) -> tuple[Array, Array, Array]:
        """Period, first value and end of the turn around the centre of each component of p, (np,) each.

        The period of an initial value is that of its state coordinate. Without a period there is no end.
        """
        in_state, slots, _ = self.slots
        periods = self.box.periods.copy()
        periods[in_state] = self.states.periods[slots]
        endless = np.where(periods > 0, 0.0, np.inf)
        first = self.box.centre - periods / 2
        return periods, first - SEAM * periods - endless, first + (1 - SEAM) * periods + endless

    def in_one_turn(self, p: Array) -> tuple[Array, Array]:
        """``p`` (B, np) with its angles in the turn around the centre of the box, and the whole turns from there back.

        Angles that are in that turn already are not changed by a bit. The second array, (B, nx), holds the whole turns
        in the units of the states: what is added to states of the first to obtain those of ``p`` as it was written.
        """
        periods, first, end = self.turn
        turns = np.zeros((len(p), len(self.states)))
        here = (p >= first) & (p < end)
        if here.all():
            return p, turns
        columns = periods > 0
        within = p.copy()
        low, period = self.box.centre[columns] - periods[columns] / 2, periods[columns]
        turned = low + np.mod(p[:, columns] - low, period)
        turned = np.where(turned >= end[columns], turned - period, turned)
        within[:, columns] = np.where(here[:, columns], p[:, columns], turned)
        in_state, slots, _ = self.slots
        turns[:, slots] = (p - within)[:, in_state]
        return within, turns

    @checked
    def check(self, p: ArrayLike, extrapolate: bool) -> Array:
        """``p`` as a float64 array (B, np), inside the box unless ``extrapolate``, finite in any case.

        Inside is also what whole turns of angles bring inside; it is returned as it was written.

        Raises:
            ValueError: wrong shape, or a value that is not finite.
            OutsideBoxError: outside the box by more than 1e-6 of its width.
        """
        array = np.array(p, dtype=np.float64, ndmin=2)
        if array.ndim != 2 or array.shape[1] != len(self.box):
            raise ValueError(
                f"{self.owner}: expected parameters ({', '.join(self.box.names)}) of shape "
                f"(B, {len(self.box)}) or ({len(self.box)},), got {np.shape(p)}"
            )
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise ValueError(f"{self.owner}: parameters must be finite; row {row} is {array[row]}")
        if extrapolate or self.box.contains(array, BOX_TOLERANCE).all():
            return array
        outside = ~self.box.contains(self.in_one_turn(array)[0], BOX_TOLERANCE)
        if outside.any():
            row = int(np.flatnonzero(outside)[0])
            raise OutsideBoxError(
                f"{self.owner}: parameters {array[row]} (row {row}, {int(outside.sum())} of {len(array)} rows) lie "
                f"outside the box {self.box.lower} … {self.box.upper}; pass extrapolate=True to accept them"
            )
        return array
