"""Powered descent of a rocket onto a pad, in a vertical plane (Açıkmeşe & Ploen, *Convex programming approach to
powered descent guidance for Mars landing*, Journal of Guidance, Control, and Dynamics 30, 2007).

    ẋ = v_x,   ż = v_z,   v̇_x = (T/m) sin θ,   v̇_z = (T/m) cos θ − g,   θ̇ = ω,   ṁ = −α T,   L = 1000 α T

The engine cannot be switched off: the thrust T lies between two positive bounds. θ is the tilt from the vertical, and ω
its rate, the second control, which the paper does not limit. The cost is the propellant, kg; the mass is a state whose
final value is free. The rocket lands upright and at rest, above a glide slope of tan γ = 2 whose apex lies 5 m below
the pad. Lengths are in metres, masses in tonnes and forces in kilonewtons.

Plans use 5.8 to 12.4 kN and 0.4 rad/s of the 4.972 to 13.258 kN and 0.5 rad/s that the rocket has, so that a regulator
can correct where the plan is at its bounds, as plans of least propellant are nearly everywhere. Bounds of the thrust,
α, g and the wet mass are the paper's; the box of parameters and the tolerances are decisions of this project.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ocp_envs.goal import FREE, Goal
from ocp_envs.picture import Face, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate, Expression, System

#: α is the propellant for each unit of impulse, s/m, that is t/s for each kN; ``slope`` is tan γ, ``apex`` in metres.
CONSTANTS = {"gravity": 3.7114, "alpha": 5.09e-4, "slope": 2.0, "apex": 5.0}
#: The rocket is drawn this many times its size of about 4 m.
DRAWN_SCALE = 20.0


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    _, _, vx, vz, tilt, mass = state
    thrust, rate = control
    a = thrust / mass
    return [vx, vz, a * ca.sin(tilt), a * ca.cos(tilt) - c.gravity, rate, -c.alpha * thrust]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control`` with the constants ``c``, kg/s, whatever ``context``."""
    return 1000 * c.alpha * control[0]


def clearance(state: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace) -> list[Expression]:
    """Heights of ``state`` above the sides of the glide slope of the constants ``c``, m, whatever ``context``."""
    x, z = state[:2]
    return [z + c.apex - c.slope * x, z + c.apex + c.slope * x]


def _body(state: Array, context: Array) -> list[Shape]:
    foot, tilt = state[:2], state[4]
    along, across = np.array([np.sin(tilt), np.cos(tilt)]), np.array([np.cos(tilt), -np.sin(tilt)])
    outline = ((-0.4, 0.6), (-0.4, 3.0), (0.0, 4.0), (0.4, 3.0), (0.4, 0.6))
    legs = [(foot + DRAWN_SCALE * (0.6 * along + side * np.outer((0.4, 1.0), across))) for side in (-1, 1)]
    wall, apex = np.array([-560.0, 0.0, 560.0]), CONSTANTS["apex"]
    return [
        Line(np.stack([wall, CONSTANTS["slope"] * np.abs(wall) - apex], axis=1), 1.0, "#b5532b"),
        Line(np.array([[-40.0, 0.0], [40.0, 0.0]]), 4.0, "#3f4a57"),
        *(Line(np.stack([hip, foot + side * DRAWN_SCALE * across]), 2.0) for side, (hip, _) in zip((-1, 1), legs)),
        Face(np.array([foot + DRAWN_SCALE * (a * across + b * along) for a, b in outline]), "#1f4e79"),
    ]


def _path(states: Array) -> Array:
    return states[:, :2]


ROCKET = OptimalControlProblem(
    id="RocketLanding-v0",
    title="land a rocket with the least propellant",
    system=System(
        name="rocket",
        state=Box(
            (
                Coordinate("x", -1000.0, 1000.0, "m", scale=200.0),
                Coordinate("z", -50.0, 2000.0, "m", scale=300.0),
                Coordinate("vx", -100.0, 100.0, "m/s", scale=20.0),
                Coordinate("vz", -150.0, 50.0, "m/s", scale=30.0),
                Coordinate("tilt", -1.4, 1.4, "rad", scale=0.5),
                Coordinate("mass", 1.4, 2.0, "t", scale=0.2),
            )
        ),
        control=Box(
            (Coordinate("thrust", 4.972, 13.258, "kN", scale=3.0), Coordinate("rate", -0.5, 0.5, "rad/s", scale=0.3))
        ),
        constants=CONSTANTS,
        dynamics=dynamics,
    ),
    parameters=Box(
        (
            Coordinate("x", -250.0, 250.0, "m"),
            Coordinate("z", 800.0, 1000.0, "m"),
            Coordinate("vx", -20.0, 20.0, "m/s"),
            Coordinate("vz", -30.0, 0.0, "m/s"),
        )
    ),
    cost_rate=cost_rate,
    goal=Goal([0.0, 0.0, 0.0, 0.0, 0.0, FREE], tolerance=[2.0, 2.0, 1.0, 1.0, 0.1, 1.0], control=[7.0, 0.0]),
    duration=(5.0, 80.0),
    knots=31,
    substeps=2,
    hold=0.0,
    time_limit=100.0,
    rest=np.array([0.0, 900.0, 0.0, -15.0, 0.0, 1.905]),
    clearance=clearance,
    planned={"z": (0.0, 2000.0), "thrust": (5.8, 12.4), "rate": (-0.4, 0.4), "tilt": (-1.2, 1.2)},
    picture=Picture(
        limits=((-600.0, 600.0), (-60.0, 1140.0)),
        body=_body,
        path=_path,
        caption=f"rocket drawn {DRAWN_SCALE:g} times its size",
    ),
)
