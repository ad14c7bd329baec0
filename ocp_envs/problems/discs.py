"""Planar quadcopter that flies past three discs, each of which it may pass above or below.

    ẍ = −(u_1 + u_2) sin θ / m,   z̈ = (u_1 + u_2) cos θ / m − g,   θ̈ = l (u_2 − u_1) / I
    L = 1 + 0.1 ω² + 0.05 ((u_1 − u_h)² + (u_2 − u_h)²),   u_h = m g / 2

It flies from rest at x = −8 to rest at the origin. Heights, centres and radii of the discs are parameters; the radii
include that of the vehicle. Passing above or below each disc makes 2³ homotopy classes, the declared solution families:
no continuous change takes a path from one to another without crossing a disc. Vehicle and box are our decisions.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ocp_envs.goal import Goal, Modes
from ocp_envs.picture import Ball, Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.system import Box, Coordinate, Expression, System
from ocp_envs.trajectory import Trajectory

CONSTANTS = {"mass": 0.5, "gravity": 9.81, "arm": 0.175, "inertia": 0.0023}
HOVER_THRUST = CONSTANTS["mass"] * CONSTANTS["gravity"] / 2
DISCS = (1, 2, 3)
#: The centres of each disc lie between these values of x, m.
BANDS = ((-6.6, -5.4), (-4.6, -3.4), (-2.6, -1.4))
#: The vehicle is drawn this many times its size.
DRAWN_SCALE = 2.0


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    _, _, theta, vx, vz, omega = state
    left, right = control
    thrust = (left + right) / c.mass
    turn = c.arm * (right - left) / c.inertia
    return [vx, vz, omega, -thrust * ca.sin(theta), thrust * ca.cos(theta) - c.gravity, turn]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control`` with the constants ``c``, whatever ``context``."""
    hover = c.mass * c.gravity / 2
    return 1 + 0.1 * state[5] ** 2 + 0.05 * sum((u - hover) ** 2 for u in control)


def clearance(state: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace) -> list[Expression]:
    """Distances of ``state`` from the discs in ``context``, m, whatever the constants ``c``."""
    x, z = state[:2]
    discs = [[getattr(context, f"{name}{i}") for name in ("cx", "cz", "r")] for i in DISCS]
    return [((x - cx) ** 2 + (z - cz) ** 2 + 1e-12) ** 0.5 - r for cx, cz, r in discs]


def _sides(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array) -> Ints:
    context = problem.start(parameters)[1]
    family = np.zeros(len(context), dtype=np.int64)
    for i in range(len(DISCS)):
        cx, cz = context[:, 3 * i], context[:, 3 * i + 1]
        paths = zip(cx, *(trajectory.states[:, :, k] for k in (0, 1)))
        height = np.array([np.interp(at, *(row[np.argsort(x)] for row in (x, z))) for at, x, z in paths])
        family = 2 * family + (height > cz)
    return family


def _body(state: Array, context: Array) -> list[Shape]:
    along = DRAWN_SCALE * CONSTANTS["arm"] * np.array([np.cos(state[2]), np.sin(state[2])])
    mast = 0.4 * np.array([-along[1], along[0]])
    outline = state[:2] + np.array([mast - along, -along, along, mast + along])
    return [*(Ball(row[:2], float(row[2]), "#b5532b", 0.45) for row in context.reshape(-1, 3)), Line(outline, 5.0)]


def _path(states: Array) -> Array:
    return states[:, :2]


PLANAR_QUADCOPTER = OptimalControlProblem(
    id="PlanarQuadcopterDiscs-v0",
    title="fly a planar quadcopter past three discs",
    system=System(
        name="planar quadcopter",
        state=Box(
            (
                Coordinate("x", -12.0, 4.0, "m", scale=3.0),
                Coordinate("z", -8.0, 8.0, "m", scale=2.0),
                Coordinate("theta", -1.5, 1.5, "rad", scale=0.5),
                *(Coordinate(n, -12.0, 12.0, "m/s", scale=3.0) for n in ("vx", "vz")),
                Coordinate("omega", -12.0, 12.0, "rad/s", scale=3.0),
            )
        ),
        control=Box(tuple(Coordinate(f"u{i}", 0.0, 6.0, "N", scale=0.5) for i in (1, 2))),
        constants=CONSTANTS,
        dynamics=dynamics,
    ),
    parameters=Box(
        (
            Coordinate("z", -2.0, 2.0, "m"),
            *(
                Coordinate(f"{name}{i}", lower, upper, "m")
                for i, band in zip(DISCS, BANDS)
                for name, lower, upper in (("cx", *band), ("cz", -1.5, 1.5), ("r", 0.4, 1.0))
            ),
        )
    ),
    cost_rate=cost_rate,
    goal=Goal(np.zeros(6), radius=0.1, control=np.full(2, HOVER_THRUST)),
    duration=(0.5, 8.0),
    knots=31,
    substeps=2,
    hold=5.0,
    time_limit=15.0,
    rest=np.array([-8.0, *np.zeros(5)]),
    clearance=clearance,
    clearance_points=3,
    planned={"theta": (-1.2, 1.2), "u1": (0.2, 5.0), "u2": (0.2, 5.0)},
    modes=Modes(tuple("".join(sides) for sides in itertools.product("-+", repeat=3)), _sides),
    picture=Picture(limits=((-9.0, 1.0), (-5.0, 5.0)), body=_body, path=_path),
)
