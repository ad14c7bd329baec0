"""Zermelo's problem: a ship crosses a current that grows with the distance from the coast, in the least time.

Bryson & Ho, *Applied Optimal Control*, sec. 2.7, example 2: from (3.66, −1.86) to the origin in 5.46 (h / V).
"""

import casadi as ca
import numpy as np

from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="Zermelo-v0",
    title="cross a current in the least time",
    system=System(
        name="ship",
        state=Box((Coordinate("x", -10.0, 10.0), Coordinate("y", -5.0, 5.0))),
        control=Box((Coordinate("heading", -np.pi, 2 * np.pi, "rad"),)),
        constants={"speed": 1.0},
        dynamics=lambda x, u, c: [c.speed * ca.cos(u[0]) - x[1], c.speed * ca.sin(u[0])],
    ),
    parameters=Box((Coordinate("x", 3.0, 4.0), Coordinate("y", -2.0, -1.5))),
    cost_rate=lambda x, u, s, c: 1,
    rest=[0.0, 0.0],
    goal=Goal([0.0, 0.0], radius=0.01, control=[2.0]),
    duration=(1.0, 10.0),
    knots=61,
    substeps=1,
    hold=0.0,
    time_limit=10.0,
)
CASE = Case(PROBLEM, [3.66, -1.86], 5.46, rel=2e-3)
