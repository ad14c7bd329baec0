"""A hang glider flies as far as it can through a thermal updraft.

COPS 3, problem 11, 1.24797e3 m with 400 intervals; OptimalControlProblems.jl, glider: 1247.978 with 500.
"""

import casadi as ca

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    px, _, vx, vy = x
    r = (px / 100 - 2.5) ** 2
    w = vy - c.updraft * (1 - r) * ca.exp(-r)
    v = ca.sqrt(vx**2 + w**2)
    pressure = c.density * c.area * v / 2 / c.mass
    drag, lift = (c.c0 + c.c1 * u[0] ** 2) * pressure, u[0] * pressure
    return [vx, vy, -lift * w - drag * vx, lift * vx - drag * w - c.gravity]


PROBLEM = OptimalControlProblem(
    id="Glider-v0",
    title="glide far",
    system=System(
        name="hang glider",
        state=Box(
            (
                Coordinate("x", 0.0, 1500.0, "m", scale=500.0),
                Coordinate("y", 800.0, 1100.0, "m", scale=50.0),
                Coordinate("vx", 0.0, 20.0, "m/s", scale=10.0),
                Coordinate("vy", -8.0, 8.0, "m/s"),
            )
        ),
        control=Box((Coordinate("lift", 0.0, 1.4),)),
        constants={
            "updraft": 2.5,
            "mass": 100.0,
            "gravity": 9.81,
            "c0": 0.034,
            "c1": 0.069662,
            "area": 14.0,
            "density": 1.13,
        },
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("y", 980.0, 1020.0, "m"),)),
    cost_rate=None,
    terminal_cost=lambda x, s, c: -x[0],
    rest=[0.0, 1000.0, 13.23, -1.288],
    goal=Goal([FREE, 900.0, 13.23, -1.288], radius=0.1, control=[0.7]),
    duration=(20.0, 150.0),
    knots=201,
    substeps=1,
    hold=0.0,
    time_limit=150.0,
)
CASE = Case(PROBLEM, [1000.0], -1247.978)
