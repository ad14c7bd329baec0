"""Maps under which a problem is invariant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A linear symmetry of order two: x → X x, u → U u, s → S s, with ẋ(X x, U u, S s) = X ẋ(x, u, s).

    Cost rate and path constraints are invariant, and so are the state and the control of the goal.

    Args:
        name: what it is, such as ``"half turn"``.
        state: X, (nx, nx), with X X = 1; a vector stands for the diagonal matrix.
        control: U, (nu, nu), likewise.
        context: S, (nc, nc), likewise.

    Raises:
        ValueError: a matrix that is not square, or not its own inverse.
    """

    name: str
    state: Array
    control: Array
    context: Array

    def __post_init__(self) -> None:
        for name in ("state", "control", "context"):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            matrix = np.diag(given) if given.ndim == 1 else given
            if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
                raise ValueError(f"{self.name}: expected a square matrix or its diagonal for {name}, got {given.shape}")
            if not np.allclose(matrix @ matrix, np.eye(len(matrix)), atol=1e-12):
                raise ValueError(f"{self.name}: the matrix of {name} is not its own inverse")
            object.__setattr__(self, name, frozen_array(matrix))

    def check(self, owner: str, nx: int, nu: int, nc: int) -> None:
        """Refuse a problem of other sizes than those of the matrices.

        Args:
            owner: the id of the problem, for messages.
            nx, nu, nc: number of its states, controls and context coordinates.

        Raises:
            ValueError: other sizes.
        """
        sizes = len(self.state), len(self.control), len(self.context)
        if sizes != (nx, nu, nc):
            raise ValueError(
                f"{owner}: expected a symmetry of {nx} states, {nu} controls and {nc} coordinates of the context, "
                f"got {sizes}"
            )

    def states(self, x: Array) -> Array:
        """X x of states (..., nx)."""
        return np.asarray(x @ self.state.T)

    def controls(self, u: Array) -> Array:
        """U u of controls (..., nu)."""
        return np.asarray(u @ self.control.T)

    def contexts(self, s: Array) -> Array:
        """S s of contexts (..., nc)."""
        return np.asarray(s @ self.context.T)

    def trajectories(self, trajectory: Trajectory) -> Trajectory:
        """The images of the B trajectories in ``trajectory``; their durations stay the same."""
        return Trajectory(self.states(trajectory.states), self.controls(trajectory.controls), trajectory.duration)
