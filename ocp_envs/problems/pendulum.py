"""Torque-limited pendulum swing-up (Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of
Experts*, section V-A).

    θ̇ = ω,   ω̇ = (τ u − m g l sin θ) / (m l²),   L = 1 + u²

θ is measured from the lower equilibrium. All constants are 1 in the paper's units; they are kept by name so that the
plant may differ from the model. The maximum torque just balances gravity when the pendulum is horizontal, so from most
initial states the pendulum has to swing. The goal is upright at rest, θ = π modulo 2π; the optimum is discontinuous
between the windings θ_f = −π, π and 3π.

The paper states θ_0 ∈ [−π, π], but its cluster sizes are those of [0, 2π], the interval centred on upright, which is
used here. The paper gives neither an operating box nor bounds of t_f; those are decisions of this project.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ocp_envs.goal import Goal, winding_modes
from ocp_envs.picture import Ball, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate, Expression, System

CONSTANTS = {"mass": 1.0, "length": 1.0, "gravity": 1.0, "torque_gain": 1.0}


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    theta, omega = state
    (u,) = control
    torque = c.torque_gain * u - c.mass * c.gravity * c.length * ca.sin(theta)
    return [omega, torque / (c.mass * c.length**2)]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control``, whatever ``context`` and the constants ``c``."""
    (u,) = control
    return 1 + u**2


def _body(state: Array, context: Array) -> list[Shape]:
    tip = np.array([np.sin(state[0]), -np.cos(state[0])])
    return [
        Line(np.array([[0.0, 0.0], tip]), width=6, color="#8c4a2f"),
        Ball(tip, 0.12, color="#8c4a2f"),
        Ball(np.zeros(2), 0.04),
    ]


def _path(states: Array) -> Array:
    return np.stack([np.sin(states[:, 0]), -np.cos(states[:, 0])], axis=1)


PENDULUM = OptimalControlProblem(
    id="PendulumSwingup-v0",
    title="swing a torque-limited pendulum up and stop upright",
    system=System(
        name="pendulum",
        state=Box(
            (
                Coordinate("theta", -4 * np.pi, 6 * np.pi, "rad", scale=3.0, period=2 * np.pi),
                Coordinate("omega", -6.0, 6.0, "rad/s", scale=2.0),
            )
        ),
        control=Box((Coordinate("u", -1.0, 1.0, "N m", scale=1.0),)),
        constants=CONSTANTS,
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("theta", 0.0, 2 * np.pi, "rad"), Coordinate("omega", -2.0, 2.0, "rad/s"))),
    cost_rate=cost_rate,
    goal=Goal(
        state=np.array([np.pi, 0.0]), radius=0.1, windings=np.array([[-1, 0], [0, 0], [1, 0]]), control=np.zeros(1)
    ),
    duration=(0.1, 8.0),
    knots=25,
    substeps=1,
    modes=winding_modes(("theta_f = -pi", "theta_f = pi", "theta_f = 3 pi")),
    hold=5.0,
    time_limit=20.0,
    picture=Picture(limits=((-1.3, 1.3), (-1.3, 1.3)), body=_body, path=_path),
)
