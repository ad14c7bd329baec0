"""The shape of a hanging chain: the length is an integral with a given end, and the optimum is 5.06858.

COPS 3 (Dolan, Moré & Munson, 2004), problem 4, and OptimalControlProblems.jl, chain: 5.06858 with 500 intervals.
"""

import casadi as ca

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    stretch = ca.sqrt(1 + u[0] ** 2)
    return [u[0], x[0] * stretch, stretch]


PROBLEM = OptimalControlProblem(
    id="Chain-v0",
    title="hang with the least potential energy",
    system=System(
        name="chain",
        state=Box((Coordinate("h", -2.0, 5.0), Coordinate("energy", -5.0, 10.0), Coordinate("length", 0.0, 8.0))),
        control=Box((Coordinate("slope", -20.0, 20.0, scale=5.0),)),
        constants={"total": 4.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("h", 0.8, 1.2), Coordinate("total", 3.5, 4.5))),
    cost_rate=None,
    terminal_cost=lambda x, s, c: x[1],
    rest=[1.0, 0.0, 0.0],
    goal=Goal(lambda s, c: [3.0, FREE, c.total], radius=0.01),
    duration=(1.0, 1.0),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=1.0,
)
CASE = Case(PROBLEM, [1.0, 4.0], 5.06858)
