"""A catalyst shared between two reactions: bang, singular, bang.

OptimalControlProblems.jl, jackson: −0.191822 with 500 intervals (Jackson, 1968; Biegler, *Nonlinear
Programming*, 2010).
"""

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    first, second = u[0] * (c.k1 * x[0] - c.k2 * x[1]), (1 - u[0]) * c.k3 * x[1]
    return [-first, first - second, second]


PROBLEM = OptimalControlProblem(
    id="Jackson-v0",
    title="make most of a substance",
    system=System(
        name="reactor",
        state=Box(tuple(Coordinate(name, 0.0, 1.1) for name in "abd")),
        control=Box((Coordinate("u", 0.0, 1.0),)),
        constants={"k1": 1.0, "k2": 10.0, "k3": 1.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("k2", 5.0, 15.0),)),
    cost_rate=None,
    terminal_cost=lambda x, s, c: -x[2],
    rest=[1.0, 0.0, 0.0],
    goal=Goal([FREE, FREE, FREE]),
    duration=(4.0, 4.0),
    knots=201,
    substeps=1,
    hold=0.0,
    time_limit=4.0,
)
CASE = Case(PROBLEM, [10.0], -0.191822)
