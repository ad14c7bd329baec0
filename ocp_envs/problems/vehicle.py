"""Ground vehicle that drives to the origin (Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture
of Experts*, section V-B).

    ẋ = v sin θ,   ẏ = v cos θ,   θ̇ = k_θ u_θ v,   v̇ = k_v u_v,   L = 10 + u_θ² + u_v²

θ is the heading, measured from the y axis, and k_θ u_θ is the curvature of the path, so the vehicle turns only while it
moves. It may drive forwards or backwards, and arrive with a whole turn more or less: there are six families of optimal
trajectories, one for each winding θ_f ∈ {−2π, 0, 2π} and sign of the mean speed. At rest the linearisation is not
stabilisable (∂f/∂u loses rank at v = 0), so there is no terminal regulation, and success is evaluated at the end of the
plan.

The paper gives neither bounds of u and t_f nor an operating box; |u| ≤ 5 reproduces its cluster sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.goal import Goal, Modes, winding_modes
from ocp_envs.picture import Line, Picture, Shape
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate, Expression, System
from ocp_envs.trajectory import Trajectory

CONSTANTS = {"steering_gain": 1.0, "speed_gain": 1.0}
WINDINGS = (-1, 0, 1)


def dynamics(state: Sequence[Expression], control: Sequence[Expression], c: SimpleNamespace) -> list[Expression]:
    """ẋ of ``state`` and ``control`` with the constants ``c``."""
    _, _, theta, v = state
    u_theta, u_v = control
    return [v * ca.sin(theta), v * ca.cos(theta), c.steering_gain * u_theta * v, c.speed_gain * u_v]


def cost_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """L of ``state`` and ``control``, whatever ``context`` and the constants ``c``."""
    u_theta, u_v = control
    return 10 + u_theta**2 + u_v**2


_BY_WINDING = winding_modes([f"theta_f = {2 * k} pi" for k in WINDINGS])


def _classify(
    problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, multipliers: Array
) -> NDArray[np.int64]:
    forwards = trajectory.states[:, :, 3].mean(axis=1) >= 0
    return 2 * _BY_WINDING.classify(problem, parameters, trajectory, multipliers) + forwards


MODES = Modes(tuple(f"{name}, {way}" for name in _BY_WINDING.names for way in ("backwards", "forwards")), _classify)


def _body(state: Array, context: Array) -> list[Shape]:
    x, y, theta, _ = state
    ahead, right = np.array([np.sin(theta), np.cos(theta)]), np.array([np.cos(theta), -np.sin(theta)])
    centre = np.array([x, y])
    corners = [
        centre + a * ahead + b * right for a, b in ((-0.9, -0.5), (0.9, -0.5), (0.9, 0.5), (-0.9, 0.5), (-0.9, -0.5))
    ]
    nose = [centre + 0.4 * ahead - 0.5 * right, centre + 0.9 * ahead, centre + 0.4 * ahead + 0.5 * right]
    return [Line(np.array(corners), 2.0, "#1f4e79"), Line(np.array(nose), 2.0, "#c8102e")]


def _path(states: Array) -> Array:
    return states[:, :2]


VEHICLE = OptimalControlProblem(
    id="GroundVehicle-v0",
    title="drive a vehicle to the origin and stop there, facing along the y axis",
    system=System(
        name="ground vehicle",
        state=Box(
            (
                Coordinate("x", -40.0, 40.0, "m", scale=5.0),
                Coordinate("y", -40.0, 40.0, "m", scale=5.0),
                Coordinate("theta", -4 * np.pi, 4 * np.pi, "rad", scale=2.0, period=2 * np.pi),
                Coordinate("v", -10.0, 10.0, "m/s", scale=4.0),
            )
        ),
        control=Box(
            (
                Coordinate("u_theta", -5.0, 5.0, "1/m", scale=1.0),
                Coordinate("u_v", -5.0, 5.0, "m/s²", scale=2.0),
            )
        ),
        constants=CONSTANTS,
        dynamics=dynamics,
    ),
    parameters=Box(
        (
            Coordinate("x", -10.0, 10.0, "m"),
            Coordinate("y", -10.0, 10.0, "m"),
            Coordinate("theta", -np.pi, np.pi, "rad"),
            Coordinate("v", -3.1, 3.1, "m/s"),
        )
    ),
    cost_rate=cost_rate,
    goal=Goal(
        state=np.zeros(4),
        radius=0.5,
        windings=np.array([[0, 0, k, 0] for k in WINDINGS]),
        control=np.zeros(2),
    ),
    duration=(0.1, 10.0),
    knots=25,
    substeps=1,
    modes=MODES,
    hold=0.0,
    time_limit=20.0,
    picture=Picture(limits=((-14.0, 14.0), (-14.0, 14.0)), body=_body, path=_path),
)
