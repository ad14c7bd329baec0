"""A particle in a dielectrophoretic field, in the least time.

OptimalControlProblems.jl, dielectrophoretic_particle: 7.81132 with 500 intervals (Chang, Petit & Rouchon,
*Time-optimal control of a particle in a dielectrophoretic system*, 2006).
"""

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

PROBLEM = OptimalControlProblem(
    id="Dielectrophoretic-v0",
    title="move a particle in the least time",
    system=System(
        name="particle",
        state=Box((Coordinate("x", -1.0, 4.0), Coordinate("y", -3.0, 3.0))),
        control=Box((Coordinate("u", -1.0, 1.0),)),
        constants={"alpha": -0.75, "c": 1.0},
        dynamics=lambda x, u, c: [x[1] * u[0] + c.alpha * u[0] ** 2, -c.c * x[1] + u[0]],
    ),
    parameters=Box((Coordinate("x", 0.8, 1.2), Coordinate("alpha", -0.8, -0.6))),
    cost_rate=lambda x, u, s, c: 1,
    rest=[1.0, 0.0],
    goal=Goal([2.0, FREE], radius=0.01, control=[0.5]),
    duration=(1.0, 20.0),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=20.0,
)
CASE = Case(PROBLEM, [1.0, -0.75], 7.81132)
