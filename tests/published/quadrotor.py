"""A quadrotor with a bound of its tilt reaches a point at rest, nearly in the least time.

OptimalControlProblems.jl, quadrotor: 1.4925 with 60 intervals, 1.4928 in another implementation (Vanroye et al.,
*FATROP*, 2023).
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    _, _, _, vx, vy, vz, phi, theta = x
    thrust, dphi, dtheta, psi = u
    ax = ca.cos(psi) * ca.sin(theta) * ca.cos(phi) + ca.sin(psi) * ca.sin(phi)
    ay = ca.sin(psi) * ca.sin(theta) * ca.cos(phi) - ca.cos(psi) * ca.sin(phi)
    az = ca.cos(theta) * ca.cos(phi)
    return [vx, vy, vz, thrust * ax, thrust * ay, thrust * az - c.gravity, dphi, dtheta]


def cost_rate(x, u, s, c):
    return 1 + 1e-8 * (x[6] ** 2 + x[7] ** 2 + u[3] ** 2 + u[0] ** 2) + 100 * u[3] ** 2


POSITION = [Coordinate(name, -10.0, 10.0, "m") for name in ("px", "py", "pz")]
VELOCITY = [Coordinate(name, -20.0, 20.0, "m/s", scale=3.0) for name in ("vx", "vy", "vz")]
ANGLES = [Coordinate(name, -np.pi / 2, np.pi / 2, "rad") for name in ("phi", "theta")]
RATES = [Coordinate(name, -3.0, 3.0, "rad/s") for name in ("dphi", "dtheta")]
PROBLEM = OptimalControlProblem(
    id="Quadrotor-v0",
    title="fly sideways and stop",
    system=System(
        name="quadrotor",
        state=Box((*POSITION, *VELOCITY, *ANGLES)),
        control=Box((Coordinate("thrust", 0.0, 45.9, scale=10.0), *RATES, Coordinate("psi", -1.0, 1.0, "rad"))),
        constants={"gravity": 9.81},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("py", -1.0, 1.0, "m"),)),
    cost_rate=cost_rate,
    clearance=lambda x, s, c: [ca.cos(x[7]) * ca.cos(x[6]) - np.cos(0.55)],
    rest=[0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0],
    goal=Goal([0.01, 5.0, 2.5, 0, 0, 0, FREE, FREE], radius=0.1, control=[9.81, 0, 0, 0]),
    duration=(0.3, 4.0),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=4.0,
)
CASE = Case(PROBLEM, [0.0], 1.4925)
