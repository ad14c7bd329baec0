"""The problem of Bryson and Denham: a double integrator below a limit, with the least energy.

OptimalControlProblems.jl, bryson_denham; 4 / (9 l) for l < 1/6 (Bryson & Ho, *Applied Optimal Control*, sec. 3.11), 4
for l = 1/9.
"""

from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="BrysonDenham-v0",
    title="come back in a second and stay below a limit",
    system=System(
        name="mass",
        state=Box((Coordinate("x", -0.1, 0.3, scale=0.1), Coordinate("v", -2.0, 2.0))),
        control=Box((Coordinate("u", -20.0, 20.0, scale=5.0),)),
        constants={},
        dynamics=lambda x, u, c: [x[1], u[0]],
    ),
    parameters=Box((Coordinate("limit", 0.08, 0.16),)),
    cost_rate=lambda x, u, s, c: u[0] ** 2 / 2,
    clearance=lambda x, s, c: [s.limit - x[0]],
    rest=[0.0, 1.0],
    goal=Goal([0.0, -1.0], radius=0.01),
    duration=(1.0, 1.0),
    knots=121,
    substeps=1,
    hold=0.0,
    time_limit=1.0,
)
CASE = Case(PROBLEM, [1 / 9], 4.0)
