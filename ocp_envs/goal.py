"""The goal of a problem, and the solution families into which its optimal trajectories fall."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.support import fields
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.doors import checked
from ocp_envs.system import System, inside
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

#: (problem, parameters (B, np), B trajectories, multipliers of the clearances at the knots (B, N, nh)) → family of each
#: trajectory, (B,).
Classify = Callable[["OptimalControlProblem", Array, Trajectory, Array], Ints]


@dataclass(frozen=True, eq=False)
class Goal:
    """The goal ball.

    Args:
        state: centre of the ball, (nx,), each component in the unit of its coordinate.
        radius: the ball is ‖x − state‖ < radius, the shortest difference being taken in periodic coordinates.
        windings: whole turns added to the periodic coordinates of the goal, (W, nx); the solver tries each row.
        control: control that keeps the system at the goal, (nu,).

    Raises:
        TypeError: an argument of another type.
        ValueError: a state or control that is not finite, a radius that is not positive and finite, or windings that
            are not whole, twice the same, or none.
    """

    state: Array
    radius: float
    windings: Ints
    control: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", fields.vector("goal", "state", self.state))
        object.__setattr__(self, "radius", fields.positive("goal", "radius", self.radius))
        object.__setattr__(self, "windings", fields.whole_rows("goal", "windings", self.windings))
        object.__setattr__(self, "control", fields.vector("goal", "control", self.control))

    def __repr__(self) -> str:
        state, control = (", ".join(f"{value:.4g}" for value in values) for values in (self.state, self.control))
        return f"Goal([{state}], radius={self.radius:g}, {len(self.windings)} windings, control=[{control}])"

    def check(self, owner: str, system: System) -> None:
        """Refuse a system that the goal does not fit.

        Args:
            owner: the id of the problem, for messages.
            system: the system.

        Raises:
            ValueError: other shapes than those of state and control, a winding of a coordinate without a period, or a
                goal state, a goal control or a target outside the operating box.
        """
        nx, nu = system.nx, system.nu
        if self.state.shape != (nx,) or self.control.shape != (nu,) or self.windings.shape[1:] != (nx,):
            raise ValueError(
                f"{owner}: expected a goal with state ({nx},), control ({nu},), windings (W, {nx}); "
                f"got {self.state.shape}, {self.control.shape}, {self.windings.shape}"
            )
        if np.any(self.windings[:, system.state.periods == 0]):
            raise ValueError(f"{owner}: goal.windings has whole turns of a coordinate without a period")
        inside(owner, "goal.state", self.state, system.state)
        inside(owner, "goal.control", self.control, system.control)
        for row in self.windings:
            inside(
                owner,
                f"the goal with the winding {row.tolist()}",
                self.state + row * system.state.periods,
                system.state,
            )


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
        if len(self.names) != len(problem.targets):
            raise ValueError(
                f"{problem.id}: winding_modes needs a name for each of the {len(problem.targets)} rows of "
                f"goal.windings, got {len(self.names)}: {list(self.names)}"
            )
        distance = np.abs(trajectory.states[:, -1, None, :] - problem.targets).sum(axis=-1)
        return np.asarray(distance.argmin(axis=1), dtype=np.int64)
