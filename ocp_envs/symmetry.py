"""Maps under which a problem is invariant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.support.doors import checked
from ocp_envs.system import Box
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

_POINTS = 6


def _equal(a: Array, b: Array) -> bool:
    return bool(np.allclose(a, b, rtol=1e-8, atol=1e-9, equal_nan=True))


def _covers(box: Box, points: Array) -> bool:
    """Whether ``points`` (B, n) lie in ``box``, wherever they may in coordinates that repeat."""
    return bool(box.contains(np.where(box.periods > 0, box.centre, points), 1e-9).all())


@checked
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

    def check_invariance(self, problem: OptimalControlProblem) -> None:
        """Refuse a ``problem`` that the map changes, as its functions, boxes and goal show at a few points.

        Raises:
            ValueError: something differs; the message names it.
        """
        rng = np.random.Generator(np.random.Philox(key=20190622))
        system, rate = problem.system, problem.functions.rate()
        boxes = {"state": system.state, "control": system.control, "context": problem.context}
        x, u, s = (np.vstack([box.draw(rng, _POINTS), box.lower, box.upper]) for box in boxes.values())
        images = self.states(x), self.controls(u), self.contexts(s)
        (f, cost), (f_image, cost_image) = rate(x, u, s), rate(*images)
        goal, held, held_image = (
            problem.terminal.states(s),
            problem.terminal.controls(s),
            problem.terminal.controls(images[2]),
        )
        same = {
            **{f"box of {name}": _covers(box, image) for (name, box), image in zip(boxes.items(), images)},
            "dynamics": _equal(f_image, self.states(f)),
            "cost_rate": _equal(cost_image, cost),
            "goal.state": _equal(problem.goal_error(self.states(goal), images[2]), np.zeros(len(goal))),
            "goal.control": _equal(self.controls(held), held_image),
            "initial states": self._maps_starts(problem, rng),
        }
        if problem.n_clearances:
            h = problem.functions.clearances()
            same["clearance"] = _equal(np.sort(h(images[0], images[2])[0]), np.sort(h(x, s)[0]))
        if different := [name for name, equal in same.items() if not equal]:
            raise ValueError(
                f"{problem.id}: symmetry {self.name!r} is none of this problem, it changes {', '.join(different)}; "
                "correct its matrices, or leave symmetry at None"
            )

    def _maps_starts(self, problem: OptimalControlProblem, rng: np.random.Generator) -> bool:
        """Whether images of initial states and contexts are those of other parameters."""
        states, contexts = problem.start(problem.parameters.draw(rng, _POINTS))
        images = self.states(states), self.contexts(contexts)
        return all(_equal(a, b) for a, b in zip(problem.start(problem.parameters_of(*images)), images))

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
