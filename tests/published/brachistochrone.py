"""The curve of the fastest descent between two points.

dymos, example "The Brachistochrone", and OptimalControlProblems.jl, brachistochrone: 1.8016 s, on a cycloid.
"""

import casadi as ca

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="Brachistochrone-v0",
    title="slide down in the least time",
    system=System(
        name="bead",
        state=Box(
            (
                Coordinate("x", 0.0, 12.0, "m", scale=5.0),
                Coordinate("y", -2.0, 12.0, "m", scale=5.0),
                Coordinate("v", 0.0, 20.0, "m/s", scale=10.0),
            )
        ),
        control=Box((Coordinate("theta", 0.0, 3.0, "rad"),)),
        constants={"gravity": 9.80665},
        dynamics=lambda x, u, c: [x[2] * ca.sin(u[0]), -x[2] * ca.cos(u[0]), c.gravity * ca.cos(u[0])],
    ),
    parameters=Box((Coordinate("y", 8.0, 11.0, "m"),)),
    cost_rate=lambda x, u, s, c: 1,
    rest=[0.0, 10.0, 0.0],
    goal=Goal([10.0, 5.0, FREE], radius=0.01, control=[1.0]),
    duration=(0.5, 4.0),
    knots=61,
    substeps=1,
    hold=0.0,
    time_limit=4.0,
)
CASE = Case(PROBLEM, [10.0], 1.8016)
