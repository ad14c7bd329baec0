"""A robot arm with a linear and two rotary joints moves from rest to rest in the least time.

COPS 3, problem 8, 9.14101 with 400 intervals; OptimalControlProblems.jl, robot: 9.141125 with 250.
"""

import casadi as ca
import numpy as np

from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    rho, drho, _, dtheta, phi, dphi = x
    inertia = ((c.length - rho) ** 3 + rho**3) / 3
    return [drho, u[0] / c.length, dtheta, u[1] / inertia / ca.sin(phi) ** 2, dphi, u[2] / inertia]


PROBLEM = OptimalControlProblem(
    id="Robot-v0",
    title="move an arm in the least time",
    system=System(
        name="robot arm",
        state=Box(
            (
                Coordinate("rho", 0.0, 5.0),
                Coordinate("drho", -5.0, 5.0),
                Coordinate("theta", -np.pi, np.pi, "rad"),
                Coordinate("dtheta", -5.0, 5.0, "rad/s"),
                Coordinate("phi", 0.0, np.pi, "rad"),
                Coordinate("dphi", -5.0, 5.0, "rad/s"),
            )
        ),
        control=Box(tuple(Coordinate(name, -1.0, 1.0) for name in ("force", "torque", "lift"))),
        constants={"length": 5.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("angle", 1.5, 2.5, "rad"),)),
    cost_rate=lambda x, u, s, c: 1,
    rest=[4.5, 0.0, 0.0, 0.0, np.pi / 4, 0.0],
    goal=Goal(lambda s, c: [4.5, 0, s.angle, 0, np.pi / 4, 0], radius=0.01),
    duration=(2.0, 20.0),
    knots=121,
    substeps=1,
    hold=0.0,
    time_limit=20.0,
)
CASE = Case(PROBLEM, [2 * np.pi / 3], 9.14101)
