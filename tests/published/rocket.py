"""Goddard's rocket climbs as high as it can: a singular arc.

COPS 3, problem 10, and OptimalControlProblems.jl, rocket: 1.012837 with 500 intervals. Declared is the climb,
0.012837: with the constant 1 in the cost, the solver's tolerance is 0.4 % of it.
"""

import casadi as ca

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    h, v, m = x
    drag = c.drag * v**2 * ca.exp(-500 * (h - 1))
    return [v, (u[0] - drag) / m - 1 / h**2, -2 * u[0]]


PROBLEM = OptimalControlProblem(
    id="Rocket-v0",
    title="climb high",
    system=System(
        name="rocket",
        state=Box(
            (
                Coordinate("h", 1.0, 1.1, scale=0.01),
                Coordinate("v", 0.0, 0.5, scale=0.1),
                Coordinate("m", 0.6, 1.0, scale=0.2),
            )
        ),
        control=Box((Coordinate("thrust", 0.0, 3.5),)),
        constants={"drag": 310.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("drag", 200.0, 400.0),)),
    cost_rate=None,
    terminal_cost=lambda x, s, c: 1 - x[0],
    rest=[1.0, 0.0, 1.0],
    goal=Goal([FREE, FREE, 0.6], radius=0.01),
    duration=(0.05, 0.5),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=0.5,
)
CASE = Case(PROBLEM, [310.0], -0.012837)
