"""Swing-up of a pole on a cart (Kelly, *An introduction to trajectory optimization: how to do your own direct
collocation*, SIAM Review 59, 2017, section 6 and appendix E.1).

    ẋ = v,   θ̇ = ω,
    v̇ = (F + l m ω² sin θ + m g cos θ sin θ) / (M + m sin² θ)
    ω̇ = −(F cos θ + l m ω² cos θ sin θ + (M + m) g sin θ) / (l (M + m sin² θ))
    L = 1 + 0.02 F²

θ is measured from hanging. The cart begins at rest where it has to stop, with the pole at any angle and rate; the goal
is upright at rest, θ = π modulo 2π. The optimum is discontinuous between the windings θ_f = −3π, −π, π and 3π. The
paper swings the pole up from hanging in a given time and distance at the least ∫ F² dt; the price of time, the box of
parameters and the bounds are decisions of this project.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ocp_envs.goal import Goal, winding_modes
from ocp_envs.picture import Ball, Face, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate, Expression, System

CONSTANTS = {"cart": 1.0, "pole": 0.3, "length": 0.5, "gravity": 9.81}
WINDINGS = (-2, -1, 0, 1)


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    _, theta, v, omega = state
    sine, cosine = ca.sin(theta), ca.cos(theta)
    inertia = c.cart + c.pole * sine**2
    push = control[0] + c.length * c.pole * omega**2 * sine
    return [
        v,
        omega,
        (push + c.pole * c.gravity * cosine * sine) / inertia,
        -(push * cosine + (c.cart + c.pole) * c.gravity * sine) / (c.length * inertia),
    ]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control``, whatever ``context`` and the constants ``c``."""
    return 1 + 0.02 * control[0] ** 2


def _body(state: Array, context: Array) -> list[Shape]:
    cart = np.array([state[0], 0.0])
    tip = cart + CONSTANTS["length"] * np.array([np.sin(state[1]), -np.cos(state[1])])
    corners = cart + np.array([[-0.25, -0.1], [0.25, -0.1], [0.25, 0.1], [-0.25, 0.1]])
    return [
        Line(np.array([[-5.0, -0.1], [5.0, -0.1]]), 1.0, "#3f4a57"),
        Face(corners, "#1f4e79"),
        Line(np.array([cart, tip]), width=5, color="#8c4a2f"),
        Ball(tip, 0.08, color="#8c4a2f"),
    ]


def _path(states: Array) -> Array:
    x, theta, length = states[:, 0], states[:, 1], CONSTANTS["length"]
    return np.stack([x + length * np.sin(theta), -length * np.cos(theta)], axis=1)


CART_POLE = OptimalControlProblem(
    id="CartPoleSwingup-v0",
    title="swing a pole up and stop it above its cart",
    system=System(
        name="cart and pole",
        state=Box(
            (
                Coordinate("x", -5.0, 5.0, "m"),
                Coordinate("theta", -4 * np.pi, 4 * np.pi, "rad", scale=3.0, period=2 * np.pi),
                Coordinate("v", -20.0, 20.0, "m/s", scale=3.0),
                Coordinate("omega", -25.0, 25.0, "rad/s", scale=5.0),
            )
        ),
        control=Box((Coordinate("force", -15.0, 15.0, "N", scale=5.0),)),
        constants=CONSTANTS,
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("theta", -np.pi, np.pi, "rad"), Coordinate("omega", -3.0, 3.0, "rad/s"))),
    cost_rate=cost_rate,
    goal=Goal(
        state=np.array([0, np.pi, 0, 0]),
        radius=0.1,
        windings=np.array([[0, k, 0, 0] for k in WINDINGS]),
        control=np.zeros(1),
    ),
    duration=(0.2, 5.0),
    knots=31,
    substeps=2,
    modes=winding_modes([f"theta_f = {2 * k + 1} pi" for k in WINDINGS]),
    hold=5.0,
    time_limit=12.0,
    picture=Picture(limits=((-1.5, 1.5), (-1.0, 1.0)), body=_body, path=_path),
)
