"""A truck with two trailers parks: constraints on the path, and on the angles between its parts at the end.

OptimalControlProblems.jl, truck_trailer: 59.2303 with 200 intervals (Vanroye et al., *FATROP*, 2023). The collection
leaves the initial velocity and steering angle free; they are parameters here, at their best values.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

RIGHT = np.pi / 2


def dynamics(x, u, c):
    _, _, theta0, theta1, theta2, v, delta = x
    first, second = theta0 - theta1, theta1 - theta2
    turn0 = v / 0.4 * ca.tan(delta)
    turn1 = (v * ca.sin(first) - c.hitch0 * ca.cos(first) * turn0) / 1.1
    v1 = v * ca.cos(first) + c.hitch0 * ca.sin(first) * turn0
    turn2 = (v1 * ca.sin(second) - c.hitch1 * ca.cos(second) * turn1) / 0.8
    v2 = v1 * ca.cos(second) + c.hitch1 * ca.sin(second) * turn1
    return [v2 * ca.cos(theta2), v2 * ca.sin(theta2), turn0, turn1, turn2, u[0], u[1]]


PROBLEM = OptimalControlProblem(
    id="TruckTrailer-v0",
    title="park a truck with two trailers",
    system=System(
        name="truck and trailers",
        state=Box(
            (
                Coordinate("x", -10.0, 10.0, "m"),
                Coordinate("y", -10.0, 10.0, "m"),
                Coordinate("theta0", -RIGHT, RIGHT, "rad"),
                Coordinate("theta1", -RIGHT, RIGHT, "rad"),
                Coordinate("theta2", -3.0, 3.0, "rad"),
                Coordinate("v", -0.2, 0.2, "m/s", scale=0.1),
                Coordinate("delta", -np.pi / 6, np.pi / 6, "rad", scale=0.3),
            )
        ),
        control=Box((Coordinate("dv", -1.0, 1.0, scale=0.1), Coordinate("rate", -np.pi / 10, np.pi / 10, scale=0.1))),
        constants={"hitch0": 0.1, "hitch1": 0.2},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("v", -0.2, 0.2, "m/s"), Coordinate("delta", -np.pi / 6, np.pi / 6, "rad"))),
    cost_rate=lambda x, u, s, c: 1 + (x[2] - x[3]) ** 2 + (x[3] - x[4]) ** 2,
    clearance=lambda x, s, c: [sign * angle + RIGHT for angle in (x[2] - x[3], x[3] - x[4]) for sign in (1, -1)],
    rest=np.zeros(7),
    goal=Goal([0.0, -2.0, RIGHT, RIGHT, RIGHT, FREE, FREE], radius=0.01),
    duration=(10.0, 100.0), knots=161, substeps=1, hold=0.0, time_limit=100.0,
)  # fmt: skip
CASE = Case(PROBLEM, [0.2, 0.0], 59.2303)
