"""A particle is steered to an altitude and a velocity in the least time.

COPS 3, problem 9 (Bryson & Ho, sec. 2.4), and OptimalControlProblems.jl, steering: 0.554572 with 500 intervals.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="Steering-v0",
    title="reach an altitude and a velocity",
    system=System(
        name="particle",
        state=Box(
            (
                Coordinate("x", -5.0, 50.0, scale=10.0),
                Coordinate("y", -5.0, 20.0, scale=5.0),
                Coordinate("vx", -50.0, 100.0, scale=20.0),
                Coordinate("vy", -50.0, 100.0, scale=20.0),
            )
        ),
        control=Box((Coordinate("angle", -np.pi / 2, np.pi / 2, "rad"),)),
        constants={"thrust": 100.0},
        dynamics=lambda x, u, c: [x[2], x[3], c.thrust * ca.cos(u[0]), c.thrust * ca.sin(u[0])],
    ),
    parameters=Box((Coordinate("thrust", 80.0, 120.0),)),
    cost_rate=lambda x, u, s, c: 1,
    rest=[0.0, 0.0, 0.0, 0.0],
    goal=Goal([FREE, 5.0, 45.0, 0.0], radius=0.1),
    duration=(0.1, 2.0),
    knots=61,
    substeps=1,
    hold=0.0,
    time_limit=2.0,
)
CASE = Case(PROBLEM, [100.0], 0.554572)
