"""Other distributions of the parameters p: normal, from a table, conditioned, or of a user's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.distribution import UNIFORM, Distribution
from ocp_envs.support import fields
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked
from ocp_envs.system import Box
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

#: Draws after which a parameter is given up.
_PATIENCE = 10_000


def _first_accepted(
    owner: str,
    generators: Sequence[np.random.Generator],
    draw: Callable[[Sequence[np.random.Generator]], Array],
    accepts: Callable[[Array], Bools],
) -> Array:
    """The first row that ``draw`` makes with each of ``generators`` and that ``accepts`` accepts, (B, np)."""
    rows = draw(generators)
    for _ in range(_PATIENCE):
        again = np.flatnonzero(~np.asarray(accepts(rows), dtype=bool))
        if not len(again):
            return rows
        rows[again] = draw([generators[i] for i in again.tolist()])
    raise ValueError(f"{owner}: none of {_PATIENCE} draws was accepted; widen the box, or condition on less")


@checked
@dataclass(frozen=True, eq=False)
class Normal(Distribution):
    """Independent normal coordinates, drawn again until they are in the parameter box.

    Args:
        mean: (np,).
        deviation: standard deviations, (np,), positive.

    Raises:
        ValueError: values that are not finite, or deviations that are not positive.
    """

    mean: ArrayLike
    deviation: ArrayLike

    def __post_init__(self) -> None:
        for name in ("mean", "deviation"):
            object.__setattr__(self, name, fields.vector("Normal", name, getattr(self, name)))
        if (self._moments[1] <= 0).any():
            raise ValueError(f"Normal: deviation must be positive, got {self._moments[1]}")

    @property
    def _moments(self) -> tuple[Array, Array]:
        return np.asarray(self.mean, dtype=np.float64), np.asarray(self.deviation, dtype=np.float64)

    def check(self, problem: OptimalControlProblem) -> None:
        """Refuse a ``problem`` with another number of parameters, or whose box is far from the mean."""
        (mean, deviation), box = self._moments, problem.parameters
        if mean.shape != (len(box),) or deviation.shape != (len(box),):
            raise ValueError(
                f"{problem.id}: Normal needs a mean and a deviation for each of {list(box.names)}, got the shapes "
                f"{mean.shape} and {deviation.shape}"
            )
        far = (box.lower - mean > 3 * deviation) | (mean - box.upper > 3 * deviation)
        if far.any():
            names = [name for name, is_far in zip(box.names, far) if is_far]
            raise ValueError(f"{problem.id}: the mean of {names} lies more than three deviations outside the box")

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters of ``problem``, (B, np), one drawn from each of ``generators``."""
        (mean, deviation), box = self._moments, problem.parameters

        def normal(of: Sequence[np.random.Generator]) -> Array:
            return np.asarray(mean + np.array([g.standard_normal(len(box)) for g in of]) * deviation)

        return _first_accepted(problem.id, generators, normal, box.contains)

    @property
    def text(self) -> str:
        return "normal, within the box"

    def over(self, change: Callable[[Box], Box]) -> Normal:
        return self


@checked
@dataclass(frozen=True, eq=False)
class Table(Distribution):
    """Rows of a table, each equally likely.

    Args:
        rows: parameters, (R, np), inside the parameter box.

    Raises:
        ValueError: no rows, or values that are not finite.
    """

    rows: ArrayLike

    def __post_init__(self) -> None:
        rows = np.array(self.rows, dtype=np.float64)
        if rows.ndim != 2 or not len(rows) or not np.isfinite(rows).all():
            raise ValueError(
                f"Table: rows must be finite parameters (R, np), at least one row, got the shape {rows.shape}"
            )
        rows.flags.writeable = False
        object.__setattr__(self, "rows", rows)

    def check(self, problem: OptimalControlProblem) -> None:
        """Refuse a ``problem`` with another number of parameters, or whose box does not contain the rows."""
        problem.parametrisation.check(np.asarray(self.rows), extrapolate=False)

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters of ``problem``, (B, np), one row chosen by each of ``generators``."""
        rows = np.asarray(self.rows)
        return np.array(rows[[int(generator.integers(len(rows))) for generator in generators]])

    @property
    def text(self) -> str:
        return f"one of {len(np.asarray(self.rows))} rows of a table"

    def over(self, change: Callable[[Box], Box]) -> Table:
        raise ValueError("parameters from a table cannot be drawn over another box")


@checked
@dataclass(frozen=True, eq=False)
class Conditioned(Distribution):
    """Another distribution on condition that a function accepts the parameters.

    Args:
        accepts: parameters (B, np) → which rows are accepted, (B,).
        of: the distribution that is drawn from until a row is accepted; by default the uniform one.
        name: what the condition is, for the documentation of the problem.
    """

    accepts: Callable[[Array], Bools]
    of: Distribution = UNIFORM
    name: str = "a condition"

    def check(self, problem: OptimalControlProblem) -> None:
        """Refuse a ``problem`` that the other distribution does not fit, or none of whose instances is accepted."""
        self.of.check(problem)
        self.draw(problem, [np.random.Generator(np.random.Philox(key=i)) for i in range(4)])

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters of ``problem``, (B, np), one drawn from each of ``generators``."""
        return _first_accepted(problem.id, generators, lambda of: self.of.draw(problem, of), self.accepts)

    @property
    def text(self) -> str:
        return f"{self.of.text} on {self.name}"

    def over(self, change: Callable[[Box], Box]) -> Conditioned:
        return dataclasses.replace(self, of=self.of.over(change))


@checked
@dataclass(frozen=True, eq=False)
class Sampler(Distribution):
    """A distribution of the user's own.

    Args:
        function: a random generator → parameters of one instance, (np,).
        name: what it is, for the documentation of the problem.
    """

    function: Callable[[np.random.Generator], ArrayLike]
    name: str = "drawn by a function"

    def check(self, problem: OptimalControlProblem) -> None:
        """Refuse a ``problem`` for which the function returns no parameters in the box."""
        few = [np.random.Generator(np.random.Philox(key=i)) for i in range(4)]
        problem.parametrisation.check(self.draw(problem, few), extrapolate=False)

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters of ``problem``, (B, np), one drawn from each of ``generators``."""
        width = len(problem.parameters)
        drawn = [np.asarray(self.function(generator), dtype=np.float64) for generator in generators]
        if wrong := [row.shape for row in drawn if row.shape != (width,)]:
            raise ValueError(f"{problem.id}: the sampler must return parameters ({width},), got the shape {wrong[0]}")
        return np.array(drawn).reshape(len(drawn), width)

    @property
    def text(self) -> str:
        return self.name

    def over(self, change: Callable[[Box], Box]) -> Sampler:
        raise ValueError("parameters drawn by a function cannot be drawn over another box")


@checked
@dataclass(frozen=True, eq=False)
class OnTheWay(Distribution):
    """States on the way along trajectories, moved as by a push, and drawn again until they are in the parameter box.

    They are the instances that a plan meets which is renewed; ``problem.from_any_state`` has all of them in its box.

    Args:
        trajectories: B trajectories, finite; each is equally likely, and so is each time along it.
        contexts: of their instances, (B, nc).
        deviation: standard deviations of what is added to each coordinate of the state, (nx,), not negative.

    Raises:
        ValueError: other numbers of rows, or values that are not finite or negative.
    """

    trajectories: Trajectory
    contexts: ArrayLike
    deviation: ArrayLike

    def __post_init__(self) -> None:
        contexts = np.array(self.contexts, dtype=np.float64)
        object.__setattr__(self, "contexts", contexts)
        deviation = fields.vector("OnTheWay", "deviation", self.deviation)
        object.__setattr__(self, "deviation", deviation)
        if (deviation < 0).any():
            raise ValueError(f"OnTheWay: deviation must not be negative, got {deviation}")
        count = len(self.trajectories)
        if contexts.ndim != 2 or len(contexts) != count or not count or not self.trajectories.finite.all():
            raise ValueError(
                f"OnTheWay: expected finite trajectories, at least one, with contexts (B, nc), got {count} of them and "
                f"contexts {contexts.shape}"
            )

    def check(self, problem: OptimalControlProblem) -> None:
        """Refuse a ``problem`` whose states or contexts have other sizes."""
        sizes = self.trajectories.states.shape[2], np.asarray(self.contexts).shape[1], np.size(self.deviation)
        expected = problem.system.nx, len(problem.context), problem.system.nx
        if sizes != expected:
            raise ValueError(
                f"{problem.id}: OnTheWay needs states, contexts and deviations of {expected} coordinates, got {sizes}"
            )
        self.draw(problem, [np.random.Generator(np.random.Philox(key=i)) for i in range(4)])

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters of ``problem``, (B, np), one drawn from each of ``generators``."""

        def on_the_way(of: Sequence[np.random.Generator]) -> Array:
            row = np.array([g.integers(len(self.trajectories)) for g in of])
            time = np.array([g.uniform(0, self.trajectories.knots - 1) for g in of])
            knot = np.minimum(time.astype(np.int64), self.trajectories.knots - 2)
            part, states = (time - knot)[:, None], self.trajectories.states
            along = (1 - part) * states[row, knot] + part * states[row, knot + 1]
            moved = along + np.array([g.standard_normal(along.shape[1]) for g in of]) * np.asarray(self.deviation)
            return problem.in_one_turn(problem.parameters_of(moved, np.asarray(self.contexts)[row]))[0]

        return _first_accepted(problem.id, generators, on_the_way, problem.parameters.contains)

    @property
    def text(self) -> str:
        return f"on the way along {len(self.trajectories)} trajectories"

    def over(self, change: Callable[[Box], Box]) -> OnTheWay:
        return self
