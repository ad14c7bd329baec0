"""Discrete linear-quadratic regulators: at the goal, and along a plan.

With A and B the derivatives of the *discrete* step x⁺ = F(x, u) of ``dt`` seconds, the cost Σ δxᵀQδx + δuᵀRδu has the
backward Riccati recursion (Anderson & Moore, *Optimal Control: Linear Quadratic Methods*, chapter 2)

    K = (R + BᵀPB)⁻¹ BᵀPA,    P ← Q + AᵀP(A − BK),    δu = −K δx.

Along a plan it starts from the terminal weight at the plan's last tick, and R may grow where the plan leaves a control
little room to its bounds: with Bryson's rule, the weight of a quantity is the inverse square of the deviation that is
acceptable (Bryson & Ho, *Applied Optimal Control*, section 5.2), and a clipped correction corrects nothing. With ρ the
distance of ū to the nearer bound as a share of the middle's,

    R_k = R / max(ρ_k, room)²,    room = 1: constant.

At the goal A and B are constant and P is the
stabilising solution of the algebraic Riccati equation, found by python-control.

A control must stay in its box. The cost of one tick and of what follows is, but for a constant,
(u − u*)ᵀ H (u − u*) with H = R + BᵀPB and the unconstrained u* = ū − K δx, so the best control of the box is the
nearest one in that metric: where one rotor stops, the others still make up for the torque. Clipping is the same for a
single control, or for one that no other makes up for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import control
import numpy as np
from numpy.typing import NDArray

from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.system import Box

#: Where a goal cannot be held, the error at the end of a plan counts as much as so many ticks of it.
TERMINAL_FACTOR = 10.0
#: The recursion linearises at most this many different numbers of plans, see :meth:`Regulator.along`.
_SIZES = 8
#: Sweeps of :func:`nearest_control` at most, and the change of a control, as a share of its range, that ends them.
_SWEEPS, _SETTLED = 100, 1e-9


@dataclass(frozen=True, eq=False)
class TrackingWeights:
    """Weights of the tracking cost, one sum over ticks.

    Args:
        state: diagonal of Q, (nx,).
        control: diagonal of R, (nu,), positive.
        terminal: weight of the error at the end of a plan, (nx, nx); by default the solution of the algebraic Riccati
            equation at the goal, which is what the hold costs from there, and 10 Q where the goal cannot be held.
        room: least ρ that counts in the module's formula, in (0, 1].

    Raises:
        ValueError: values that are not finite or outside their range.
    """

    state: Array
    control: Array
    terminal: Array | None = None
    room: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", frozen_array(self.state))
        object.__setattr__(self, "control", frozen_array(self.control))
        if self.terminal is not None:
            object.__setattr__(self, "terminal", frozen_array(self.terminal))
        if not (np.isfinite(self.state).all() and (self.state >= 0).all()):
            raise ValueError(f"state weights must be finite and not negative, got {self.state}")
        if not (np.isfinite(self.control).all() and (self.control > 0).all()):
            raise ValueError(f"control weights must be finite and positive, got {self.control}")
        if not 0 < self.room <= 1:
            raise ValueError(f"room must lie in (0, 1], got {self.room}")

    @classmethod
    def uniform(
        cls,
        problem: OptimalControlProblem,
        state: float = 10.0,
        control: float = 0.1,
        terminal: float | None = None,
        room: float = 1.0,
    ) -> TrackingWeights:
        """Multiples of the identity in SI units; ``terminal`` as for the class where it is ``None``."""
        nx, nu = problem.system.nx, problem.system.nu
        return cls(np.full(nx, state), np.full(nu, control), None if terminal is None else terminal * np.eye(nx), room)

    @classmethod
    def default(cls, problem: OptimalControlProblem) -> TrackingWeights:
        """Those of :data:`CHOSEN`; Q = 10 I and R = 0.1 I for other problems."""
        return cls.uniform(problem, **CHOSEN.get(problem.id, {}))


#: Arguments of :meth:`TrackingWeights.uniform` by environment, where others than its own serve better on the
#: development set: ``scripts/choose_tracking.py`` compares them. The quadcopter corrects sideways errors by tilting,
#: which takes time: a heavy end makes it begin early. Climbing plans end with the rotors off, where nothing can be
#: corrected any more.
CHOSEN: Mapping[str, Mapping[str, float]] = MappingProxyType(
    dict.fromkeys(
        ("Quadcopter-v0", "QuadcopterObstacle-v0"),
        MappingProxyType({"state": 1.0, "control": 10.0, "terminal": 1e5, "room": 0.1}),
    )
)


def nearest_control(wanted: Array, metric: Array, box: Box) -> Array:
    """The controls of ``box`` nearest to the ``wanted`` ones, each in its own metric.

    Coordinate descent: each control in turn takes the best value given the others, which converges for a box and a
    positive definite metric (Tseng, *Convergence of a block coordinate descent method*, 2001).

    Args:
        wanted: (B, nu).
        metric: H, (B, nu, nu), symmetric and positive definite.
        box: of the controls.
    """
    nearest = np.clip(wanted, box.lower, box.upper)
    rows = np.flatnonzero((nearest != wanted).any(axis=1))
    if len(box) == 1 or not len(rows):
        return nearest
    u, h, target = nearest[rows], metric[rows], wanted[rows]
    for _ in range(_SWEEPS):
        before = u.copy()
        for i in range(len(box)):
            slope = (h[:, i] * (u - target)).sum(axis=1)
            u[:, i] = np.clip(u[:, i] - slope / h[:, i, i], box.lower[i], box.upper[i])
        if (np.abs(u - before) <= _SETTLED * box.width).all():
            break
    nearest[rows] = u
    return nearest


class Regulator:
    """Feedback gains for one problem and one control period.

    Args:
        problem: the problem.
        dt: control period, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.

    Attributes:
        hold: gain at the goal, (nu, nx); zero where the goal cannot be held.
        hold_metric: H there, (nu, nu); the identity where the goal cannot be held.
        terminal: weight at the end of a plan, (nx, nx).

    Raises:
        ValueError: weights of the wrong shape, a control period that is not positive and finite.
    """

    def __init__(self, problem: OptimalControlProblem, dt: float, weights: TrackingWeights | None = None) -> None:
        weights = weights or TrackingWeights.default(problem)
        nx, nu = problem.system.nx, problem.system.nu
        terminal = weights.terminal
        if weights.state.shape != (nx,) or weights.control.shape != (nu,):
            raise ValueError(
                f"{problem.id}: expected state weights ({nx},) and control weights ({nu},), "
                f"got {weights.state.shape} and {weights.control.shape}"
            )
        if terminal is not None and terminal.shape != (nx, nx):
            raise ValueError(f"{problem.id}: expected a terminal weight ({nx}, {nx}), got {terminal.shape}")
        self.problem, self.dt, self.weights = problem, float(dt), weights
        self._linearise = problem.batch_linearisation(Simulator(problem, dt).substeps)
        self.hold, self.hold_metric, end = self._at_goal()
        self.terminal: Array = end if terminal is None else terminal

    def _at_goal(self) -> tuple[Array, Array, Array]:
        """Gain, metric and cost-to-go of the hold (0, I, 10 Q where there is none) in the middle of the contexts."""
        problem, weights = self.problem, self.weights
        nx, nu = problem.system.nx, problem.system.nu
        if problem.hold == 0:
            return np.zeros((nu, nx)), np.eye(nu), TERMINAL_FACTOR * np.diag(weights.state)
        context = (problem.context.lower + problem.context.upper) / 2
        a, b = self.linearise(problem.goal.state[None], problem.goal.control[None], context[None])
        r = np.diag(weights.control)
        gain, cost_to_go, _ = control.dlqr(a[0], b[0], np.diag(weights.state), r)
        return np.asarray(gain), np.asarray(r + b[0].T @ cost_to_go @ b[0]), np.asarray(cost_to_go)

    def linearise(self, states: Array, controls: Array, contexts: Array) -> tuple[Array, Array]:
        """A (B, nx, nx) and B (B, nx, nu) of the step of ``dt`` seconds at (B, nx), (B, nu), (B, nc)."""
        size, nx, nu = len(states), self.problem.system.nx, self.problem.system.nu
        a, b = self._linearise(states, controls, contexts, np.full((size, 1), self.dt))
        return np.ascontiguousarray(a).reshape(size, nx, nx), np.ascontiguousarray(b).reshape(size, nx, nu)

    def along(self, states: Array, controls: Array, contexts: Array, ticks: NDArray[np.int64]) -> tuple[Array, Array]:
        """Time-varying gains and metrics along plans of different lengths.

        Args:
            states: (B, T+1, nx), references at the ticks.
            controls: (B, T, nu), feed-forward of each tick.
            contexts: (B, nc).
            ticks: (B,), length of each plan, at most T.

        Returns:
            K (B, T+1, nu, nx) and H (B, T+1, nu, nu): from a plan's last tick on, those of the hold.
        """
        size, longest, nu = controls.shape
        nx = states.shape[2]
        gains = np.empty((size, longest + 1, nu, nx))
        gains[:] = self.hold
        metrics = np.empty((size, longest + 1, nu, nu))
        metrics[:] = self.hold_metric
        # The longest plans first: at each tick the plans under way are a prefix. Prefixes are rounded up to a few
        # sizes, because each new batch size costs the setting up of a mapped function.
        order = np.argsort(-ticks, kind="stable")
        under_way = np.searchsorted(-ticks[order], -np.arange(longest), side="left")
        unit = -(-size // _SIZES)
        q, weight = np.diag(self.weights.state), self._control_weights(controls)
        p = np.tile(self.terminal, (size, 1, 1))
        for k in range(longest - 1, -1, -1):
            n = int(under_way[k])
            padded = order[: min(size, -(-n // unit) * unit)]
            a, b = self.linearise(states[padded, k], controls[padded, k], contexts[padded])
            a, b, rows = a[:n], b[:n], order[:n]
            bp = b.swapaxes(1, 2) @ p[:n]
            metric = weight[rows, k, :, None] * np.eye(nu) + bp @ b
            gain = np.linalg.solve(metric, bp @ a)
            gains[rows, k], metrics[rows, k] = gain, metric
            following = q + a.swapaxes(1, 2) @ p[:n] @ (a - b @ gain)
            p[:n] = (following + following.swapaxes(1, 2)) / 2
        return gains, metrics

    def _control_weights(self, controls: Array) -> Array:
        """Diagonals of R_k for plans with ``controls`` (B, T, nu), of the same shape."""
        box = self.problem.system.control
        share = 2 * np.minimum(controls - box.lower, box.upper - controls) / box.width
        return np.asarray(self.weights.control / np.maximum(share, self.weights.room) ** 2)
