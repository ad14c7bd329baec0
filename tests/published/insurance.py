"""Health insurance: time in the dynamics, the cost and the constraints, and a premium that is a parameter.

OptimalControlProblems.jl, insurance: −2.0592143 with 500 intervals. The premium, which equals what is expected to be
paid out, is free in the collection; it is a parameter here, at its best value. Four of the collection's controls are
functions of the state and are not declared.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def illness(t):
    return 0.25 * ca.exp(-0.25 * t) + np.exp(-2.5) / 10


def revenue(x, c):
    return 1 - c.premium + x[0] - x[1]


def health(x):
    return 1.5 - 0.2 * x[3] / (1 + x[1] ** 2)


def dynamics(x, u, c):
    marginal, effect = 10 * ca.exp(-10 * revenue(x, c)), 2 * x[1] / (1 + x[1] ** 2) ** 2
    return [(1 - 0.2 * x[3] * effect / marginal) * u[0], u[0], x[0] * illness(x[3]), 1]


PROBLEM = OptimalControlProblem(
    id="Insurance-v0",
    title="insure a health",
    system=System(
        name="insurance",
        state=Box(
            (
                Coordinate("paid", 0.0, 1.5),
                Coordinate("expense", 0.0, 1.5),
                Coordinate("expected", 0.0, 5.0),
                Coordinate("t", 0.0, 11.0),
            )
        ),
        control=Box((Coordinate("h", 0.0, 25.0),)),
        constants={"premium": 0.5},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("premium", 0.3, 0.8),)),
    cost_rate=lambda x, u, s, c: -(1 - ca.exp(-10 * revenue(x, c)) + health(x)) * illness(x[3]),
    clearance=lambda x, s, c: [revenue(x, c), np.log(1e4) / 10 - revenue(x, c), health(x)],
    rest=[0.0, 0.001, 0.0, 0.0],
    goal=Goal(lambda s, c: [FREE, FREE, c.premium, FREE]),
    duration=(10.0, 10.0), knots=201, substeps=1, hold=0.0, time_limit=10.0,
)  # fmt: skip
CASE = Case(PROBLEM, [0.5425], -2.0592143)
