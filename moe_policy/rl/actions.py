"""Actions of a learner in [-1, 1], and the controls that they represent.

An action a ∈ [-1, 1]^nu represents the control u = centre + D a, clipped to its bounds. There are two kinds:

*   Over the whole box: the centre is that of the box, and D = diag(upper − lower) / 2.
*   Round the goal: the centre is the control u_g at the goal. The directions, the columns of D, are orthogonal, one for
    each independent effect that controls have on the state at the goal: with the Jacobian B of one decision period,
    in units of the states' scales, they are the columns of Q in Bᵀ P = Q R with column pivoting. For a quadcopter these
    are roll, pitch, collective thrust and yaw. A full action changes no coordinate by more than ``stride`` of its scale
    in one period, and no control beyond its bounds.
"""

from __future__ import annotations

from collections.abc import Sequence

import gymnasium as gym
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array


class Actions:
    """Actions in Gymnasium's ``space`` [-1, 1] ↔ controls of ``problem``; actions outside are clipped.

    ``centre`` (nu,) and ``directions`` (nu, nu) are those of the module; by default actions cover the whole box.

    Raises:
        ValueError: a centre or directions of another shape, or directions that are dependent.
    """

    def __init__(
        self, problem: OptimalControlProblem, centre: Array | None = None, directions: Array | None = None
    ) -> None:
        box = problem.system.control
        self._box, nu = box, len(box)
        self.centre = box.centre if centre is None else np.asarray(centre, dtype=np.float64)
        self.directions = np.diag(box.width / 2) if directions is None else np.asarray(directions, dtype=np.float64)
        if self.centre.shape != (nu,) or self.directions.shape != (nu, nu):
            got = f"{self.centre.shape} and {self.directions.shape}"
            raise ValueError(f"{problem.id}: expected a centre ({nu},) and directions ({nu}, {nu}), got shapes {got}")
        if np.linalg.matrix_rank(self.directions) < nu:
            raise ValueError(f"{problem.id}: the directions of actions must be independent, got {self.directions}")
        self.space = gym.spaces.Box(-1.0, 1.0, (nu,), dtype=np.float32)

    @classmethod
    def round_goal(cls, problem: OptimalControlProblem, stride: float | Sequence[float], period: float) -> Actions:
        """Actions round the control at the goal of ``problem``, see the module.

        Args:
            problem: the problem.
            stride: largest change of a coordinate in a period, in units of its scale; for each direction, those with
                the strongest effect first, or for all.
            period: seconds between two decisions.

        Raises:
            ValueError: a control at the goal that lies on a bound.
        """
        box, terminal = problem.system.control, problem.terminal
        goal, control = terminal.central_state[None], terminal.central_control[None]
        room = np.minimum(control[0] - box.lower, box.upper - control[0])
        if not (room > 0).all():
            raise ValueError(f"{problem.id}: actions round the goal need a control there inside its box, got {control}")
        _, effect = problem.functions.linearisation(1)(
            goal, control, problem.context.centre[None], np.full((1, 1), period)
        )
        scaled = effect[0] / problem.system.state.scale[:, None]
        across, gains, _ = scipy.linalg.qr(scaled.T, pivoting=True)
        across = across * np.where(np.diag(gains) < 0, -1.0, 1.0)
        within = (room[:, None] / np.maximum(np.abs(across), 1e-9)).min(axis=0)
        lengths = np.minimum(within, np.asarray(stride) / np.maximum(np.abs(scaled @ across).max(axis=0), 1e-9))
        return cls(problem, control[0], across * lengths)

    def controls(self, actions: ArrayLike) -> Array:
        """Controls (..., nu) in physical units, for ``actions`` (..., nu)."""
        clipped = np.clip(np.asarray(actions, dtype=np.float64), -1, 1)
        return np.clip(self.centre + clipped @ self.directions.T, self._box.lower, self._box.upper)

    def actions(self, controls: ArrayLike) -> Array:
        """The inverse of :meth:`controls` where nothing is clipped, for ``controls`` (..., nu)."""
        apart = np.asarray(controls, dtype=np.float64) - self.centre
        return np.asarray(apart @ np.linalg.inv(self.directions).T)
