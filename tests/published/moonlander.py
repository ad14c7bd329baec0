"""A lander with two thrusters reaches a point at rest in the least time; its attitude is free.

OptimalControlProblems.jl, moonlander: 0.961810 s with 500 intervals.
"""

import casadi as ca

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    _, _, vx, vy, theta, omega = x
    thrust = u[0] + u[1]
    turn = c.width / 2 * (u[1] - u[0]) / c.inertia
    return [vx, vy, -thrust * ca.sin(theta), thrust * ca.cos(theta) - c.gravity, omega, turn]


PROBLEM = OptimalControlProblem(
    id="Moonlander-v0",
    title="reach a point at rest",
    system=System(
        name="lander",
        state=Box(
            (
                Coordinate("x", -10.0, 10.0, "m"),
                Coordinate("y", -10.0, 10.0, "m"),
                Coordinate("vx", -50.0, 50.0, "m/s", scale=10.0),
                Coordinate("vy", -50.0, 50.0, "m/s", scale=10.0),
                Coordinate("theta", -10.0, 10.0, "rad"),
                Coordinate("omega", -50.0, 50.0, "rad/s", scale=10.0),
            )
        ),
        control=Box(tuple(Coordinate(name, 0.0, 19.62, "N", scale=10.0) for name in ("f1", "f2"))),
        constants={"gravity": 9.81, "width": 1.0, "inertia": 0.1},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("right", 4.0, 6.0, "m"), Coordinate("up", 4.0, 6.0, "m"))),
    cost_rate=lambda x, u, s, c: 1,
    rest=[0.0] * 6,
    goal=Goal(lambda s, c: [s.right, s.up, 0, 0, FREE, FREE], radius=0.1, control=[4.905, 4.905]),
    duration=(0.2, 4.0),
    knots=121,
    substeps=1,
    hold=0.0,
    time_limit=4.0,
)
CASE = Case(PROBLEM, [5.0, 5.0], 0.961810, starts=4)
