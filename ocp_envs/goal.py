"""The goal of a problem, and the solution families into which its optimal trajectories fall."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.support.arrays import Array, Ints, frozen_array
from ocp_envs.system import System
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
        ValueError: a radius that is not positive.
    """

    state: Array
    radius: float
    windings: Ints
    control: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", frozen_array(self.state))
        object.__setattr__(self, "windings", frozen_array(self.windings, np.int64))
        object.__setattr__(self, "control", frozen_array(self.control))
        if not self.radius > 0:
            raise ValueError(f"the goal's radius must be positive, got {self.radius}")

    def check(self, owner: str, system: System) -> None:
        """Refuse a system that the goal does not fit.

        Args:
            owner: the id of the problem, for messages.
            system: the system.

        Raises:
            ValueError: other shapes than those of state and control, or a winding of a coordinate without a period.
        """
        nx, nu = system.nx, system.nu
        if self.state.shape != (nx,) or self.control.shape != (nu,) or self.windings.shape[1:] != (nx,):
            raise ValueError(
                f"{owner}: expected a goal with state ({nx},), control ({nu},), windings (W, {nx}); "
                f"got {self.state.shape}, {self.control.shape}, {self.windings.shape}"
            )
        if np.any(self.windings[:, system.state.periods == 0]):
            raise ValueError(f"{owner}: a winding is given for a coordinate without a period")


@dataclass(frozen=True, eq=False)
class Modes:
    """The families into which the optimal trajectories of a problem fall.

    Args:
        names: one name for each family.
        classify: assigns trajectories to families, see :data:`Classify`.
    """

    names: tuple[str, ...]
    classify: Classify

    def __len__(self) -> int:
        return len(self.names)


def _all_in_one(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array) -> Ints:
    return np.zeros(len(trajectory), dtype=np.int64)


SINGLE_MODE = Modes(("all",), _all_in_one)


def winding_modes(names: Sequence[str]) -> Modes:
    """One family for each winding of the goal: that of the target nearest to the final state.

    Args:
        names: one for each row of ``goal.windings``.
    """
    return Modes(tuple(names), _nearest_target)


def _nearest_target(
    problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array
) -> Ints:
    distance = np.abs(trajectory.states[:, -1, None, :] - problem.targets).sum(axis=-1)
    return np.asarray(distance.argmin(axis=1), dtype=np.int64)
