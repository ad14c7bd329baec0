"""A problem with an obstacle, and guesses, for tests of the solver."""

import numpy as np

from ocp_envs.goal import Goal
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import guesses
from ocp_envs.system import Box, Coordinate, System


def box(**bounds):
    return Box(tuple(Coordinate(name, -b, b) for name, b in bounds.items()))


#: A point mass in the plane that has to get round a disc at the origin: p = (x, y, radius).
DISC = OptimalControlProblem(
    id="Disc-v0",
    title="move a mass round a disc",
    system=System(
        name="point mass",
        state=box(x=20.0, y=20.0, vx=10.0, vy=10.0),
        control=box(ux=10.0, uy=10.0),
        constants={},
        dynamics=lambda x, u, c: [x[2], x[3], u[0], u[1]],
    ),
    parameters=Box((*box(x=5.0, y=5.0).coordinates, Coordinate("radius", 0.1, 2.0, "m"))),
    cost_rate=lambda x, u, s, c: 1 + u[0] ** 2 + u[1] ** 2,
    goal=Goal(state=[3.0, 0, 0, 0], radius=0.1, windings=[[0] * 4], control=[0.0, 0.0]),
    duration=(0.5, 15.0),
    knots=21,
    substeps=1,
    hold=1.0,
    time_limit=20.0,
    clearance=lambda x, s, c: [(x[0] ** 2 + x[1] ** 2 + 1e-12) ** 0.5 - s.radius],
)


def line(problem, p, winding=0):
    p = np.atleast_2d(p)
    return p, guesses(problem, p, np.full(len(p), winding), np.random.default_rng(0), "line"), np.full(len(p), winding)
