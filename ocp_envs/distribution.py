"""The distribution of the parameters p of a problem, as part of its declaration.

A distribution draws the parameters that an environment needs at a reset; it never solves an optimal control problem.
Exact samples, which may need solutions, are drawn by :func:`ocp_envs.sample`.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ocp_envs import tables
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.draws import whole_numbers
from ocp_envs.system import Box

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


class Distribution(ABC):
    """The distribution of the parameter p of a problem."""

    @abstractmethod
    def check(self, problem: OptimalControlProblem) -> None:
        """Refuse a problem that the distribution does not fit, with a ``ValueError``."""

    @abstractmethod
    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters of ``problem`` for resets of its environment, (B, np), one drawn from each of ``generators``."""

    @property
    @abstractmethod
    def text(self) -> str:
        """What it is, for the documentation of a problem."""

    @abstractmethod
    def over(self, change: Callable[[Box], Box]) -> Distribution:
        """The same distribution where ``change`` is applied to the parameter box of the problem."""


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform over the parameter box."""

    def check(self, problem: OptimalControlProblem) -> None:
        """Fits every problem."""

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        box, numbers = problem.parameters, np.empty((len(generators), len(problem.parameters)))
        for generator, row in zip(generators, numbers):
            generator.random(out=row)
        return box.lower + numbers * box.width

    @property
    def text(self) -> str:
        return "uniform"

    def over(self, change: Callable[[Box], Box]) -> Uniform:
        return self


UNIFORM = Uniform()


@checked
@dataclass(frozen=True, eq=False)
class Blocked(Distribution):
    """Conditioned on the free optimum being blocked.

    The *free problem* is the problem without its path constraint. Its parameters, which are some of p, are uniform in
    their box. Given them, the other components of p are uniform on condition that the initial state and the goal are
    clear, h > 0, and that the optimal trajectory of the free problem is not. For this the ``clearance`` of the problem
    must also accept NumPy arrays.

    Args:
        free: the free problem.
        radius: the context coordinate that holds the radius of the obstacle, if that is a sphere and the clearance the
            distance from its surface; else ``None``.
        tabulated: whether optimal trajectories of ``free`` may be interpolated in a table that the package carries.
    """

    free: OptimalControlProblem
    radius: str | None = None
    tabulated: bool = True

    def check(self, problem: OptimalControlProblem) -> None:
        free, own = self.free, problem.parameters.names
        unknown = sorted(set(free.parameters.names) - set(own))
        if problem.clearance is None or unknown or free.system.state.names != problem.system.state.names:
            raise ValueError(
                f"{problem.id}: free must be this problem without its path constraint, with the same state and "
                f"parameters from {list(own)}; got {free.id} with parameters {list(free.parameters.names)}"
                + (", and there is no path constraint" if problem.clearance is None else "")
            )
        if self.radius is not None and self.radius not in problem.context.names:
            raise ValueError(
                f"{problem.id}: the radius of the obstacle must be a coordinate of the context "
                f"{list(problem.context.names)}, got {self.radius!r}"
            )

    def draw(self, problem: OptimalControlProblem, generators: Sequence[np.random.Generator]) -> Array:
        """Rows (B, np) of the parameters of ``problem`` that the package carries, one chosen by each of ``generators``.

        Raises:
            TableError: the package carries none for ``problem``.
        """
        rows = tables.starts(problem)
        return np.array(rows[whole_numbers(generators, len(rows))])

    @property
    def text(self) -> str:
        return f"conditioned on the optimal trajectory of {self.free.id} being blocked"

    def over(self, change: Callable[[Box], Box]) -> Blocked:
        # The table ends at the box.
        free = dataclasses.replace(self.free, parameters=change(self.free.parameters))
        return dataclasses.replace(self, free=free, tabulated=False)
