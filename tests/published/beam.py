"""A clamped beam with a limit of its deflection: a constraint of second order on a state.

OptimalControlProblems.jl, beam: 8.88928 with a = 0.1 and 500 intervals; 8 / (9 a) for a < 1/6 (Bryson, Denham &
Dreyfus, *Optimal programming problems with inequality constraints I*, 1963).
"""

from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="Beam-v0",
    title="bend a clamped beam with the least energy",
    system=System(
        name="beam",
        state=Box((Coordinate("x", 0.0, 0.3, scale=0.1), Coordinate("v", -2.0, 2.0))),
        control=Box((Coordinate("u", -10.0, 10.0, scale=5.0),)),
        constants={"limit": 0.1},
        dynamics=lambda x, u, c: [x[1], u[0]],
    ),
    parameters=Box((Coordinate("limit", 0.08, 0.16),)),
    cost_rate=lambda x, u, s, c: u[0] ** 2,
    clearance=lambda x, s, c: [c.limit - x[0]],
    rest=[0.0, 1.0],
    goal=Goal([0.0, -1.0], radius=0.01),
    duration=(1.0, 1.0),
    knots=121,
    substeps=1,
    hold=0.0,
    time_limit=1.0,
)
CASE = Case(PROBLEM, [0.1], 8.88928)
