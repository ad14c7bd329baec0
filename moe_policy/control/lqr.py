"""Discrete linear-quadratic regulators: at the goal, and along a plan.

With A and B the derivatives of the *discrete* step x⁺ = F(x, u) of ``dt`` seconds, the cost Σ δxᵀQδx + δuᵀRδu has the
backward Riccati recursion (Anderson & Moore, *Optimal Control: Linear Quadratic Methods*, chapter 2)

    K = (R + BᵀPB)⁻¹ BᵀPA,    P ← Q + AᵀP(A − BK),    δu = −K δx.

Along a plan the recursion starts from the terminal weight at the plan's last control step, and R may depend on the
control authority (:class:`~moe_policy.control.weights.TrackingWeights`). At the goal A and B are constant and P is the
stabilising solution of the algebraic Riccati equation, computed by python-control. H = R + BᵀPB weights the norm in
which controls are projected onto their bounds (:mod:`moe_policy.control.projection`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from moe_policy.control.riccati import References, run
from moe_policy.control.weights import TrackingWeights
from ocp_envs.control_step import runge_kutta_steps
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints

#: Where a goal cannot be held, the error at the end of a plan is weighted as that of so many control steps.
TERMINAL_FACTOR = 10.0


#: Contexts whose gains a regulator keeps at most.
_MOST_KNOWN = 100_000


class Held(NamedTuple):
    """What holds at the goal: ``gain`` K (nu, nx) and ``norm`` H (nu, nu), 0 and I where the goal cannot be held.

    The weight at the end of a plan is ``terminal`` (nx, nx).
    """

    gain: Array
    norm: Array
    terminal: Array


class Regulator:
    """Feedback gains for one problem and one control period.

    Args:
        problem: the problem.
        dt: control period, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.

    Attributes:
        central: what holds at the goal in the centre of the contexts; in all of them, unless ``varies``.
        varies: whether gains at the goal depend on the context.
        substeps: Runge-Kutta steps in a control step.

    Raises:
        TypeError: a control period that is no number.
        ValueError: weights of the wrong shape or with which no regulator holds the goal, or a control period that a
            simulator refuses.
    """

    def __init__(self, problem: OptimalControlProblem, dt: float, weights: TrackingWeights | None = None) -> None:
        weights = weights or TrackingWeights.default(problem)
        nx, nu = problem.system.nx, problem.system.nu
        for name, shape in (("state", (nx,)), ("control", (nu,)), ("terminal", (nx, nx))):
            value = getattr(weights, name)
            if value is not None and value.shape != shape:
                raise ValueError(f"{problem.id}: expected {name} weights of shape {shape}, got {value.shape}")
        # The substeps of the simulator, so that the discrete step linearised is the one it takes.
        self.substeps = runge_kutta_steps(problem, dt)
        self.problem, self.dt, self.weights = problem, float(dt), weights
        self.central = self._solved(problem.context.centre)
        self.varies = self._varies()
        self._known: dict[bytes, Held] = {}

    def _varies(self) -> bool:
        """Whether the linearisation at the goal differs in some contexts."""
        box = self.problem.context
        if self.problem.hold == 0 or not len(box):
            return False
        rng = np.random.Generator(np.random.Philox(key=20190622))
        a, b = self._linear(np.vstack([box.centre, box.lower, box.upper, box.draw(rng, 8)]))
        return bool((a != a[0]).any() or (b != b[0]).any())

    def _linear(self, contexts: Array) -> tuple[Array, Array]:
        """A (B, nx, nx) and B (B, nx, nu) at the goal in ``contexts`` (B, nc)."""
        terminal = self.problem.terminal
        return self.linearise(terminal.states(contexts), terminal.controls(contexts), contexts)

    def at_goal(self, contexts: Array) -> Held:
        """What holds at the goal in ``contexts`` (B, nc), with arrays (B, …)."""
        size = len(contexts)
        if not self.varies:
            return Held(*(np.broadcast_to(part, (size, *part.shape)) for part in self.central))
        if len(self._known) > _MOST_KNOWN:
            self._known.clear()
        rows = []
        for context in np.ascontiguousarray(contexts, dtype=np.float64):
            key = context.tobytes()
            if key not in self._known:
                self._known[key] = self._solved(context)
            rows.append(self._known[key])
        return Held(*(np.array(part).reshape(size, *known.shape) for part, known in zip(zip(*rows), self.central)))

    def _solved(self, context: Array) -> Held:
        """What holds at the goal in a ``context`` (nc,)."""
        problem, weights = self.problem, self.weights
        nx, nu = problem.system.nx, problem.system.nu
        if problem.hold == 0:
            end = TERMINAL_FACTOR * np.diag(weights.state) if weights.terminal is None else weights.terminal
            return Held(np.zeros((nu, nx)), np.eye(nu), end)
        a, b = self._linear(context[None])
        r = np.diag(weights.control)
        import control  # not before a regulator is computed: python-control loads matplotlib

        try:
            gain, cost_to_go, _ = control.dlqr(a[0], b[0], np.diag(weights.state), r)
        except np.linalg.LinAlgError as error:
            raise ValueError(
                f"{problem.id}: there is no linear regulator that holds the goal with dt = {self.dt:g} s and these "
                f"weights ({error}); choose others, or declare hold=0.0"
            ) from error
        end = np.asarray(cost_to_go) if weights.terminal is None else weights.terminal
        return Held(np.asarray(gain), np.asarray(r + b[0].T @ cost_to_go @ b[0]), end)

    def linearise(self, states: Array, controls: Array, contexts: Array) -> tuple[Array, Array]:
        """Derivatives A (B, nx, nx) and B (B, nx, nu) of the step of ``dt`` seconds.

        They are taken at ``states`` (B, nx), ``controls`` (B, nu) and ``contexts`` (B, nc).
        """
        size, nx, nu = len(states), self.problem.system.nx, self.problem.system.nu
        derivatives = self.problem.functions.linearisation(self.substeps)
        a, b = derivatives(states, controls, contexts, np.full((size, 1), self.dt))
        return np.ascontiguousarray(a).reshape(size, nx, nx), np.ascontiguousarray(b).reshape(size, nx, nu)

    def along(self, states: Array, controls: Array, contexts: Array, steps: Ints) -> tuple[Array, Array]:
        """Gains K (B, T+1, nu, nx) and norms H (B, T+1, nu, nu) along plans of different lengths.

        The plans have the references ``states`` (B, T+1, nx), the feed-forward ``controls`` (B, T, nu), ``contexts``
        (B, nc) and ``steps`` (B,), at most T. From a plan's last control step on, K and H are those at the goal.
        """
        size, longest, nu = controls.shape
        nx = states.shape[2]
        gains, norms = np.empty((size, longest + 1, nu, nx)), np.empty((size, longest + 1, nu, nu))
        held, weights = self.at_goal(contexts), self.weights
        gains[:], norms[:] = held.gain[:, None], held.norm[:, None]
        r = weights.control_at(controls, self.problem.system.control)
        plans = References(states, controls, contexts, steps, weights.state, r, held.terminal)
        run(self.linearise, plans, gains, norms)
        return gains, norms
