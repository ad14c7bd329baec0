"""Quadcopter that flies from rest to rest, without an obstacle or round a sphere.

The task is that of Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts*, section
V-C; the model that of Mellinger, Michael & Kumar, *Trajectory generation and control for precise aggressive maneuvers
with quadrotors*, 2012. Angles are Z-X-Y Euler angles, yaw ψ, roll φ and pitch θ, singular at φ = ±π/2. Rotor thrusts
u_1 … u_4 are in newtons, T is their sum, l the length of an arm, k the ratio of a rotor's moment to its thrust:

    ẍ = (sin θ cos ψ + cos θ sin φ sin ψ) T/m
    ÿ = (sin θ sin ψ − cos θ sin φ cos ψ) T/m
    z̈ = cos φ cos θ T/m − g
    φ̇ = p cos θ + r sin θ
    θ̇ = q + tan φ (p sin θ − r cos θ)
    ψ̇ = −(p sin θ − r cos θ) / cos φ
    ṗ = [l (u_2 − u_4) − q r (I_3 − I_2)] / I_1
    q̇ = [l (u_3 − u_1) − p r (I_1 − I_3)] / I_2
    ṙ = [k (u_1 − u_2 + u_3 − u_4) + p q (I_1 − I_2)] / I_3
    L = 10 + ‖v‖² + 0.1 ‖(φ, θ, ψ)‖² + ‖(p, q, r)‖² + ‖u‖²

The obstacle problem adds a sphere as context: ‖(x, y, z) − (cx, cy, cz)‖ ≥ radius. Its parameters are drawn where the
sphere blocks the free optimum: initial position and goal lie outside, and the optimal trajectory of the free problem
runs through it. Its solution families are the signs of the components of the gradient of the active constraint: of the
vector from the centre to the trajectory, averaged over the knots with the multipliers of the constraint as weights.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.distribution import Blocked
from ocp_envs.goal import Goal, Modes
from ocp_envs.picture import Ball, Face, Line, Picture, Shape, disc
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, Coordinate, Expression, System
from ocp_envs.trajectory import Trajectory

CONSTANTS = {
    "mass": 0.5,
    "gravity": 9.81,
    "moment_ratio": 0.0245,
    "arm": 0.175,
    "inertia_x": 0.0023,
    "inertia_y": 0.0023,
    "inertia_z": 0.004,
}
HOVER_THRUST = CONSTANTS["mass"] * CONSTANTS["gravity"] / 4
#: Diagonal of the state weight Q, in the paper's order (position, velocity, angles, rates).
STATE_WEIGHTS = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 1.0, 1.0, 1.0)
#: Two Runge-Kutta steps in a control step of 0.02 s. Compared with DOP853 (results/benchmark_env.json, made by
#: scripts/benchmark_env.py) the norm of the error after 0.02 s is then at most 2.5e-6 over the middle two thirds of the
#: boxes of state and control. Over the whole boxes its median is 8e-7, its 99 % quantile 2e-5 and its maximum 4e-4, for
#: a vehicle that tumbles at 8 rad/s near the singularity of the angles. With one step these four values are 4e-5,
#: 1.3e-5, 3e-4 and 1.3e-3; with four 1.6e-7, 5e-8, 1.4e-6 and 4e-5, at fewer than the required 200,000 environment
#: steps per second.
LONGEST_SUBSTEP = 0.01
#: Multipliers of the obstacle below this fraction of the largest count as zero.
NEGLIGIBLE = 1e-6
#: The constraint counts as inactive where no multiplier exceeds this value, in cost per metre. An interior-point method
#: leaves about 1e-5 at a knot that is clear of the sphere, and 0.01 to 10 at one that touches it.
INACTIVE = 1e-4


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    _, _, _, vx, vy, vz, phi, theta, psi, p, q, r = state
    u1, u2, u3, u4 = control
    s_phi, c_phi, s_theta, c_theta = ca.sin(phi), ca.cos(phi), ca.sin(theta), ca.cos(theta)
    s_psi, c_psi = ca.sin(psi), ca.cos(psi)
    thrust = (u1 + u2 + u3 + u4) / c.mass
    turn = p * s_theta - r * c_theta
    i1, i2, i3 = c.inertia_x, c.inertia_y, c.inertia_z
    return [
        vx,
        vy,
        vz,
        (s_theta * c_psi + c_theta * s_phi * s_psi) * thrust,
        (s_theta * s_psi - c_theta * s_phi * c_psi) * thrust,
        c_phi * c_theta * thrust - c.gravity,
        p * c_theta + r * s_theta,
        q + s_phi / c_phi * turn,
        -turn / c_phi,
        (c.arm * (u2 - u4) - q * r * (i3 - i2)) / i1,
        (c.arm * (u3 - u1) - p * r * (i1 - i3)) / i2,
        (c.moment_ratio * (u1 - u2 + u3 - u4) + p * q * (i1 - i2)) / i3,
    ]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control``, whatever ``context`` and the constants ``c``."""
    return 10 + sum(w * x**2 for w, x in zip(STATE_WEIGHTS, state)) + sum(u**2 for u in control)


def clearance(state: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace) -> list[Expression]:
    """Distance of ``state`` from the sphere in ``context``, metres, whatever the constants ``c``."""
    x, y, z = state[:3]
    # A power, not ca.sqrt: sampling calls this with NumPy arrays.
    return [((x - context.cx) ** 2 + (y - context.cy) ** 2 + (z - context.cz) ** 2 + 1e-12) ** 0.5 - context.radius]


def contact(problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array) -> Array:
    """Mean vector from the centre to the knots in contact, (B, 3), in m; to the closest knot where there is none.

    Args:
        problem: the obstacle problem.
        parameters: (B, 7).
        trajectory: B trajectories.
        multipliers: of the constraint at the knots, (B, N, 1); below 1e-6 of the largest they count as zero.
    """
    _, context = problem.start(parameters)
    outwards = trajectory.states[:, :, :3] - context[:, None, :3]
    weights = multipliers[:, :, 0]
    largest = weights.max(axis=1, keepdims=True)
    weights = np.where(weights >= NEGLIGIBLE * largest, weights, 0.0)
    knots = np.arange(outwards.shape[1])
    closest = knots == np.linalg.norm(outwards, axis=2).argmin(axis=1)[:, None]
    weights = np.where(largest > INACTIVE, weights, closest)
    return np.asarray((weights[:, :, None] * outwards).sum(axis=1) / weights.sum(axis=1, keepdims=True))


def _side(
    problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array
) -> NDArray[np.int64]:
    positive = contact(problem, parameters, trajectory, multipliers) >= 0
    return np.asarray(positive @ np.array([4, 2, 1]), dtype=np.int64)


#: Names: the signs of the components of :func:`contact`, x first.
SIDES = Modes(tuple("".join(signs) for signs in itertools.product("-+", repeat=3)), _side)


SYSTEM = System(
    name="quadcopter",
    state=Box(
        (
            *(Coordinate(n, -25.0, 25.0, "m", scale=5.0) for n in ("x", "y", "z")),
            *(Coordinate(n, -15.0, 15.0, "m/s", scale=5.0) for n in ("vx", "vy", "vz")),
            *(Coordinate(n, -1.2, 1.2, "rad", scale=0.5) for n in ("phi", "theta")),
            Coordinate("psi", -np.pi, np.pi, "rad", scale=0.5, period=2 * np.pi),
            *(Coordinate(n, -8.0, 8.0, "rad/s", scale=2.0) for n in ("p", "q", "r")),
        )
    ),
    control=Box(tuple(Coordinate(f"u{i}", 0.0, 4.0, "N", scale=0.1) for i in range(1, 5))),
    constants=CONSTANTS,
    dynamics=dynamics,
)
GOAL = Goal(state=np.zeros(12), radius=0.1, windings=np.zeros((1, 12), np.int64), control=np.full(4, HOVER_THRUST))
START = tuple(Coordinate(n, -10.0, 10.0, "m") for n in ("x", "y", "z"))

#: The vehicle is drawn this many times its size: 0.35 m from rotor to rotor would be invisible in a view of 24 m.
DRAWN_SCALE = 8.0


def half_turn(context: Sequence[float] = ()) -> Symmetry:
    """The 180° rotation of world and body about the vertical, which exchanges rotors 1 and 3, and 2 and 4.

    Other rotations are not symmetries, since the cost weighs roll and pitch, which they mix. Reflections are not
    either: they reverse the sign of the rotor drag torque.

    Args:
        context: diagonal of the map of the context.
    """
    over = (-1.0, -1.0, 1.0)
    return Symmetry("half turn", np.array(over * 4), np.eye(4)[[2, 3, 0, 1]], np.array(context))


def attitude(state: Array) -> Array:
    """The rotation R_z(ψ) R_x(φ) R_y(θ) from the axes of the body in ``state`` (12,) to those of the world, (3, 3).

    Thrust acts along its third column.
    """
    (s_phi, s_theta, s_psi), (c_phi, c_theta, c_psi) = np.sin(state[6:9]), np.cos(state[6:9])
    about_z = np.array([[c_psi, -s_psi, 0.0], [s_psi, c_psi, 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c_phi, -s_phi], [0.0, s_phi, c_phi]])
    about_y = np.array([[c_theta, 0.0, s_theta], [0.0, 1.0, 0.0], [-s_theta, 0.0, c_theta]])
    return np.asarray(about_z @ about_x @ about_y)


def _body(state: Array, context: Array) -> list[Shape]:
    rotation, position = attitude(state), state[:3]
    arm = DRAWN_SCALE * CONSTANTS["arm"]
    # Rotors 1 to 4 on +x, +y, −x, −y of the body, as their moments say; the first is red, to show where x points.
    hubs = arm * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    mast = np.array([0.0, 0.0, 0.15 * arm])
    shapes: list[Shape] = []
    for hub, color in zip(hubs, ("#c8102e", *["#3f4a57"] * 3)):
        ends = np.array([np.zeros(3), hub, hub + mast]) @ rotation.T
        shapes.append(Line(position + ends, 2.5, "#1f2933"))
        shapes.append(Face(disc(position + rotation @ (hub + mast), 0.55 * arm, 25, rotation), color, 0.55))
    shapes.append(Face(disc(position, 0.25 * arm, 25, rotation), "#1f2933"))
    if len(context):
        shapes.append(Ball(context[:3], float(context[3]), "#b5532b", 0.45))
    return shapes


def _path(states: Array) -> Array:
    return states[:, :3]


PICTURE = Picture(
    limits=((-12.0, 12.0),) * 3, body=_body, path=_path, caption=f"vehicle drawn {DRAWN_SCALE:g} times its size"
)

QUADCOPTER = OptimalControlProblem(
    id="Quadcopter-v0",
    title="fly a quadcopter from rest to rest",
    system=SYSTEM,
    parameters=Box(START),
    cost_rate=cost_rate,
    goal=GOAL,
    duration=(0.3, 9.0),
    knots=20,
    substeps=3,
    hold=5.0,
    time_limit=20.0,
    longest_substep=LONGEST_SUBSTEP,
    picture=PICTURE,
    symmetry=half_turn(),
)

QUADCOPTER_OBSTACLE = OptimalControlProblem(
    id="QuadcopterObstacle-v0",
    title="fly a quadcopter from rest to rest round a sphere",
    system=SYSTEM,
    parameters=Box(
        (
            *START,
            *(Coordinate(n, -10.0, 10.0, "m") for n in ("cx", "cy", "cz")),
            Coordinate("radius", 1.0, 5.0, "m"),
        )
    ),
    cost_rate=cost_rate,
    goal=GOAL,
    duration=(0.3, 10.0),
    knots=20,
    substeps=3,
    hold=5.0,
    time_limit=20.0,
    longest_substep=LONGEST_SUBSTEP,
    clearance=clearance,
    modes=SIDES,
    distribution=Blocked(free=QUADCOPTER, radius="radius"),
    picture=PICTURE,
    symmetry=half_turn((-1.0, -1.0, 1.0, 1.0)),
)
