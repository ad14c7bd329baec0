"""An electric vehicle on a road with slopes, with the least energy in a fixed time.

OptimalControlProblems.jl, electric_vehicle: 1228.60 with 500 intervals (Petit & Sciarretta, *Optimal drive of electric
vehicles using an inversion-based trajectory generation approach*, 2011).
"""

from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    road = 3 + 0.4 * x[0] - x[0] ** 2 + 0.1 * x[0] ** 3
    return [x[1], c.h1 * u[0] - c.h2 * x[1] ** 2 - c.h0 - road]


PROBLEM = OptimalControlProblem(
    id="ElectricVehicle-v0",
    title="drive with the least energy",
    system=System(
        name="electric vehicle",
        state=Box((Coordinate("x", -5.0, 20.0, scale=5.0), Coordinate("v", -10.0, 40.0, scale=10.0))),
        control=Box((Coordinate("u", -200.0, 200.0, scale=30.0),)),
        constants={"h0": 0.1, "h1": 1.0, "h2": 1e-3},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("distance", 8.0, 12.0),)),
    cost_rate=lambda x, u, s, c: u[0] * x[1] + u[0] ** 2,
    rest=[0.0, 0.0],
    goal=Goal(lambda s, c: [s.distance, 0], radius=0.1),
    duration=(1.0, 1.0),
    knots=81,
    substeps=1,
    hold=0.0,
    time_limit=1.0,
)
CASE = Case(PROBLEM, [10.0], 1228.599)
