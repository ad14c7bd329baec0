"""Van der Pol's oscillator, with a quadratic cost.

OptimalControlProblems.jl, vanderpol: 1.047812 with 500 intervals.
"""

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="VanDerPol-v0",
    title="calm an oscillator",
    system=System(
        name="Van der Pol's oscillator",
        state=Box((Coordinate("x", -5.0, 5.0), Coordinate("v", -5.0, 5.0))),
        control=Box((Coordinate("u", -5.0, 5.0),)),
        constants={},
        dynamics=lambda x, u, c: [x[1], (1 - x[0] ** 2) * x[1] - x[0] + u[0]],
    ),
    parameters=Box((Coordinate("x", 0.5, 1.5), Coordinate("v", -0.5, 0.5))),
    cost_rate=lambda x, u, s, c: (x[0] ** 2 + x[1] ** 2 + u[0] ** 2) / 2,
    rest=[1.0, 0.0],
    goal=Goal([FREE, FREE]),
    duration=(2.0, 2.0),
    knots=41,
    substeps=1,
    hold=0.0,
    time_limit=2.0,
)
CASE = Case(PROBLEM, [1.0, 0.0], 1.047812)
