"""Algae and a digester under the light of days and nights, for the most methane: time in the dynamics.

OptimalControlProblems.jl, bioreactor: −12.92545 with 600 intervals, the initial state being free in a box, which is the
box of p here; the optimum begins at its upper corner.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def growth(x, c):
    return c.mu2 * x[1] / (x[1] + c.half)


def dynamics(x, u, c):
    y, s, b, t = x
    light = ca.fmax(0, ca.sin(2 * np.pi * t / c.day)) ** 2
    eaten = growth(x, c) * b
    return [light * y / (1 + y) - (c.decay + u[0]) * y, -eaten + u[0] * (y - s), eaten - u[0] * b, 1]


PROBLEM = OptimalControlProblem(
    id="Bioreactor-v0",
    title="make methane of algae",
    system=System(
        name="bioreactor",
        state=Box(
            (
                Coordinate("y", 0.0, 20.0),
                Coordinate("s", 0.0, 20.0),
                Coordinate("b", 1e-3, 20.0),
                Coordinate("t", 0.0, 201.0, scale=100.0),
            )
        ),
        control=Box((Coordinate("u", 0.0, 1.0, scale=0.3),)),
        constants={"mu2": 0.1, "half": 0.05, "decay": 0.005, "day": 10.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("y", 0.05, 0.25), Coordinate("s", 0.5, 5.0), Coordinate("b", 0.5, 3.0))),
    cost_rate=lambda x, u, s, c: -growth(x, c) * x[2] / 3,
    rest=[0.0, 0.0, 1.0, 0.0],
    goal=Goal([FREE, FREE, FREE, FREE]),
    duration=(200.0, 200.0),
    knots=401,
    substeps=1,
    hold=0.0,
    time_limit=200.0,
)
CASE = Case(PROBLEM, [0.25, 5.0, 3.0], -12.92545)
