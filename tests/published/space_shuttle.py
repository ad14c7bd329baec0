"""The space shuttle re-enters for the largest cross-range.

Betts, *Practical Methods for Optimal Control*, sec. 6.1: 34.1412°, which is 0.595876 rad; OptimalControlProblems.jl,
space_shuttle: 0.595875 with 500 intervals. Units: 1e5 ft, 1e4 ft/s, rad, s.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

MASS, RADIUS, MU, STEEP = 203000 / 32.174, 20902900.0, 0.14076539e17, np.deg2rad(89)


def dynamics(x, u, c):
    h, v, gamma, psi, theta = x[0] * 1e5, x[3] * 1e4, x[4], x[5], x[2]
    alpha, r = u[0] * 180 / np.pi, RADIUS + h
    pressure = c.density * ca.exp(-h / 23800) * 2690 * v**2 / 2 / MASS
    drag = (0.07854 - 0.61592e-2 * alpha + 0.621408e-3 * alpha**2) * pressure
    lift, g = (-0.20704 + 0.029244 * alpha) * pressure, MU / r**2
    forward = v / r * ca.cos(gamma)
    return [
        v * ca.sin(gamma) / 1e5,
        forward * ca.sin(psi) / ca.cos(theta),
        forward * ca.cos(psi),
        (-drag - g * ca.sin(gamma)) / 1e4,
        lift / v * ca.cos(u[1]) + ca.cos(gamma) * (v / r - g / v),
        lift * ca.sin(u[1]) / (v * ca.cos(gamma)) + forward * ca.sin(psi) * ca.tan(theta),
    ]


PROBLEM = OptimalControlProblem(
    id="SpaceShuttle-v0",
    title="re-enter with the largest cross-range",
    system=System(
        name="space shuttle",
        state=Box(
            (
                Coordinate("h", 0.0, 4.0),
                Coordinate("phi", -3.0, 3.0, "rad"),
                Coordinate("theta", -STEEP, STEEP, "rad"),
                Coordinate("v", 0.01, 4.0),
                Coordinate("gamma", -STEEP, STEEP, "rad", scale=0.1),
                Coordinate("psi", -4.0, 4.0, "rad"),
            )
        ),
        control=Box((Coordinate("alpha", -np.pi / 2, np.pi / 2), Coordinate("beta", -STEEP, np.deg2rad(1)))),
        constants={"density": 0.002378},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("density", 0.0022, 0.0026),)),
    cost_rate=None,
    terminal_cost=lambda x, s, c: -x[2],
    rest=[2.6, 0.0, 0.0, 2.56, np.deg2rad(-1), np.pi / 2],
    goal=Goal([0.8, FREE, FREE, 0.25, np.deg2rad(-5), FREE], radius=0.01, control=[0.3, -1.0]),
    duration=(1750.0, 2250.0), knots=201, substeps=2, hold=0.0, time_limit=2250.0,
)  # fmt: skip
CASE = Case(PROBLEM, [0.002378], -0.595875)
