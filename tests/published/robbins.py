"""Robbins' problem: a state constraint of third order, with infinitely many contacts.

OptimalControlProblems.jl, robbins: 19.4667 with 500 intervals (Robbins, *Junction phenomena for optimal control with
state-variable inequality constraints of third order*, 1980).
"""

from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="Robbins-v0",
    title="come to rest above zero",
    system=System(
        name="triple integrator",
        state=Box((Coordinate("x", 0.0, 5.0), Coordinate("v", -5.0, 5.0), Coordinate("a", -20.0, 20.0))),
        control=Box((Coordinate("jerk", -50.0, 50.0),)),
        constants={},
        dynamics=lambda x, u, c: [x[1], x[2], u[0]],
    ),
    parameters=Box((Coordinate("x", 0.8, 1.2),)),
    cost_rate=lambda x, u, s, c: 3 * x[0] + u[0] ** 2 / 2,
    rest=[1.0, -2.0, 0.0],
    goal=Goal([0.0, 0.0, 0.0], radius=0.01),
    duration=(10.0, 10.0),
    knots=301,
    substeps=1,
    hold=0.0,
    time_limit=10.0,
)
CASE = Case(PROBLEM, [1.0], 19.4667)
