"""An extended Kalman filter of the state, and of a disturbance at the control, from the declaration of a problem.

The model is x⁺ = F(x, u + d) + w, d⁺ = d + v, y = x + n, with the control step F of the simulator and independent
normal w, v and n. Linearised at each estimate, with A and B the derivatives of F, it has the filter of Anderson &
Moore (*Optimal Filtering*, chapter 8), in which the state is augmented by d:

    P ← Φ P Φᵀ + Q,    Φ = [A B; 0 I],    K = P Hᵀ (H P Hᵀ + R)⁻¹,    [x; d] ← [x; d] + K (y ⊖ x),    P ← (I − K H) P.

A constant d that is subtracted from the control removes the steady-state error that a force, another mass or a weak
motor leaves under a linear regulator (Pannocchia & Rawlings, *Disturbance models for offset-free model-predictive
control*, 2003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.control_step import runge_kutta_steps
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch

#: Standard deviations of measurements and of the model's step are at least these parts of the scale of a coordinate.
_LEAST_NOISE, _LEAST_STEP = 1e-5, 1e-5
#: Standard deviation of the disturbance at the control initially, as a part of the control's range.
_UNKNOWN = 0.1


@checked
@dataclass(frozen=True, eq=False)
class Belief(Batch):
    """What is believed of B episodes.

    Args:
        states: their states, (B, nx).
        offset: the disturbances at their controls, (B, nu).
        covariance: of both, (B, nx + nu, nx + nu).
    """

    states: Array
    offset: Array
    covariance: Array


class KalmanFilter:
    """The filter for control steps of ``problem`` of ``dt`` seconds.

    Measurements have the standard deviations ``noise`` (nx,), derivatives of the state those of ``disturbance`` (nx,),
    drawn for each control step, and the disturbance at the control changes in a second by ``drift`` (nu,).
    """

    def __init__(
        self, problem: OptimalControlProblem, dt: float, noise: Array, disturbance: Array, drift: Array
    ) -> None:
        self.problem, self.dt = problem, dt
        self._substeps = runge_kutta_steps(problem, dt)
        scale, self._estimated = problem.system.state.scale, drift > 0
        self._noise = np.diag(np.maximum(noise, _LEAST_NOISE * scale) ** 2)
        step = np.maximum(dt * disturbance, _LEAST_STEP * scale)
        self._step = np.diag(np.concatenate([step, np.sqrt(dt) * drift]) ** 2)

    def begun(self, observed: Array) -> Belief:
        """What is believed of B episodes that begin with the states ``observed`` (B, nx)."""
        size, (nx, nu) = len(observed), (self.problem.system.nx, self.problem.system.nu)
        covariance = np.zeros((size, nx + nu, nx + nu))
        covariance[:, :nx, :nx] = self._noise
        covariance[:, nx:, nx:] = np.diag(
            np.where(self._estimated, _UNKNOWN * self.problem.system.control.width, 0) ** 2
        )
        return Belief(np.array(observed), np.zeros((size, nu)), covariance)

    def __call__(self, belief: Belief, controls: Array, contexts: Array, observed: Array) -> Belief:
        """The ``belief`` of B rows one control step later.

        The ``controls`` (B, nu) acted in ``contexts`` (B, nc), and the states ``observed`` (B, nx) follow.
        """
        nx, states, acted = self.problem.system.nx, belief.states, controls + belief.offset
        period = np.full((len(states), 1), self.dt)
        a, b = self.problem.functions.linearisation(self._substeps)(states, acted, contexts, period)
        phi = np.tile(np.eye(nx + acted.shape[1]), (len(states), 1, 1))
        phi[:, :nx, :nx], phi[:, :nx, nx:] = a.reshape(-1, nx, nx), b.reshape(-1, nx, acted.shape[1])
        covariance = phi @ belief.covariance @ phi.swapaxes(1, 2) + self._step
        gain = np.linalg.solve(covariance[:, :nx, :nx] + self._noise, covariance[:, :nx]).swapaxes(1, 2)
        expected = self.predicted(states, acted, contexts)
        change = (gain @ self.problem.system.difference(observed, expected)[..., None])[..., 0]
        covariance = covariance - gain @ covariance[:, :nx]
        return Belief(
            expected + change[:, :nx], belief.offset + change[:, nx:], (covariance + covariance.swapaxes(1, 2)) / 2
        )

    def predicted(self, states: Array, controls: Array, contexts: Array) -> Array:
        """The states (B, nx) a control step after ``states`` under ``controls`` (B, nu) in ``contexts`` (B, nc)."""
        period = np.full((len(states), 1), self.dt)
        return np.asarray(self.problem.functions.flow(self._substeps)(states, controls, contexts, period)[0])
