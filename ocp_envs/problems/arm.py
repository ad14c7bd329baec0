"""Two-link arm in a horizontal plane that reaches for a point: the goal is a parameter.

The links are uniform rods of length l_i and mass m_i, with motors of the torques τ_1, τ_2 at shoulder and elbow. With
α = m_1 l_1²/3 + m_2 l_2²/3 + m_2 l_1², β = m_2 l_1 l_2 / 2 and δ = m_2 l_2²/3 (Spong, Hutchinson & Vidyasagar, *Robot
modeling and control*, 2006, section 7.4, without gravity):

    (α + 2β cos q_2) q̈_1 + (δ + β cos q_2) q̈_2 = τ_1 + β sin q_2 (2 q̇_1 q̇_2 + q̇_2²)
    (δ + β cos q_2) q̈_1 + δ q̈_2 = τ_2 − β sin q_2 q̇_1²
    L = 1 + 0.02 (τ_1² + 4 τ_2²)

The hand is to come to rest at the distance r and the bearing φ from the shoulder. Two postures reach that point, the
elbow to either side, and the shoulder may turn either way round: q_2 = ±arccos((r² − l_1² − l_2²) / (2 l_1 l_2)),
q_1 = φ − atan2(l_2 sin q_2, l_1 + l_2 cos q_2) + 2πk. All are goals, and no solution families are declared: they can
be found. The arm begins at rest with q_1 = 0, which fixes the direction from which φ is measured. Masses, limits and
weights are decisions of this project.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ocp_envs.goal import Goal
from ocp_envs.picture import Ball, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate, Expression, System

CONSTANTS = {"mass_1": 1.0, "mass_2": 1.0, "length_1": 1.0, "length_2": 1.0}
#: Whole turns of the shoulder.
TURNS = (-1, 0, 1)


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    _, q2, w1, w2 = state
    alpha = c.mass_1 * c.length_1**2 / 3 + c.mass_2 * c.length_2**2 / 3 + c.mass_2 * c.length_1**2
    beta, delta = c.mass_2 * c.length_1 * c.length_2 / 2, c.mass_2 * c.length_2**2 / 3
    m11, m12 = alpha + 2 * beta * ca.cos(q2), delta + beta * ca.cos(q2)
    f1 = control[0] + beta * ca.sin(q2) * (2 * w1 * w2 + w2**2)
    f2 = control[1] - beta * ca.sin(q2) * w1**2
    determinant = m11 * delta - m12**2
    return [w1, w2, (delta * f1 - m12 * f2) / determinant, (m11 * f2 - m12 * f1) / determinant]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control``, whatever ``context`` and the constants ``c``."""
    return 1 + 0.02 * (control[0] ** 2 + 4 * control[1] ** 2)


def postures(context: SimpleNamespace, c: SimpleNamespace) -> list[list[Expression]]:
    """The states at rest, elbow to either side, with the hand at the point in ``context``; ``c`` are the constants."""
    bend = ca.acos((context.distance**2 - c.length_1**2 - c.length_2**2) / (2 * c.length_1 * c.length_2))
    inner = ca.atan2(c.length_2 * ca.sin(bend), c.length_1 + c.length_2 * ca.cos(bend))
    return [[context.bearing - side * inner, side * bend, 0.0, 0.0] for side in (1, -1)]


def joints(state: Array) -> Array:
    """Positions of shoulder, elbow and hand in ``state`` (4,), (3, 2) in m."""
    first, second = state[0], state[0] + state[1]
    elbow = CONSTANTS["length_1"] * np.array([np.cos(first), np.sin(first)])
    hand = elbow + CONSTANTS["length_2"] * np.array([np.cos(second), np.sin(second)])
    return np.array([np.zeros(2), elbow, hand])


def _body(state: Array, context: Array) -> list[Shape]:
    shoulder, elbow, hand = joints(state)
    target = context[0] * np.array([np.cos(context[1]), np.sin(context[1])])
    return [
        Ball(target, 0.08, color="#b5532b"),
        Line(np.array([shoulder, elbow]), width=8, color="#1f4e79"),
        Line(np.array([elbow, hand]), width=5, color="#3f4a57"),
    ]


def _path(states: Array) -> Array:
    return np.array([joints(state)[2] for state in states])


TWO_LINK_ARM = OptimalControlProblem(
    id="TwoLinkArm-v0",
    title="reach for a point with an arm of two links",
    system=System(
        name="two-link arm",
        state=Box(
            (
                Coordinate("q1", -4 * np.pi, 4 * np.pi, "rad", scale=2.0, period=2 * np.pi),
                Coordinate("q2", -3.05, 3.05, "rad", scale=2.0),
                *(Coordinate(n, -15.0, 15.0, "rad/s", scale=3.0) for n in ("w1", "w2")),
            )
        ),
        control=Box(tuple(Coordinate(n, -s, s, "N m", scale=s / 2) for n, s in (("tau1", 10.0), ("tau2", 5.0)))),
        constants=CONSTANTS,
        dynamics=dynamics,
    ),
    parameters=Box(
        (
            Coordinate("q2", -2.2, 2.2, "rad"),
            Coordinate("distance", 0.6, 1.75, "m"),
            Coordinate("bearing", -np.pi, np.pi, "rad"),
        )
    ),
    cost_rate=cost_rate,
    goal=Goal(postures, radius=0.1, windings=np.array([[k, 0, 0, 0] for k in TURNS])),
    duration=(0.2, 6.0),
    knots=25,
    rest=np.zeros(4),
    substeps=2,
    hold=0.0,
    time_limit=12.0,
    longest_substep=0.005,
    planned={"q2": (-2.9, 2.9), "tau1": (-8.0, 8.0), "tau2": (-4.0, 4.0)},
    picture=Picture(limits=((-2.2, 2.2), (-2.2, 2.2)), body=_body, path=_path),
)
