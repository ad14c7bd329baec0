"""A ducted fan moves sideways: a mean over a free time in the cost.

OptimalControlProblems.jl, ducted_fan: 1831.83 with 250 intervals (Graichen & Petit, *Incorporating a class of
constraints into the dynamics of optimal control problems*, 2009).
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case

NAMES = ("x", "vx", "y", "vy", "alpha", "omega")


def dynamics(x, u, c):
    _, vx, _, vy, alpha, omega, _, _ = x
    s, k = ca.sin(alpha), ca.cos(alpha)
    ax, ay = (u[0] * k - u[1] * s) / c.mass, (u[0] * s + u[1] * k - c.weight) / c.mass
    return [vx, ax, vy, ay, omega, c.arm * u[0] / c.inertia, 2 * u[0] ** 2 + u[1] ** 2, 1]


MOTION = [
    Coordinate(name, -np.pi / 6 if name == "alpha" else -10.0, np.pi / 6 if name == "alpha" else 10.0) for name in NAMES
]
PROBLEM = OptimalControlProblem(
    id="DuctedFan-v0",
    title="fly sideways and stop",
    system=System(
        name="ducted fan",
        state=Box((*MOTION, Coordinate("energy", 0.0, 2000.0, scale=100.0), Coordinate("t", 0.0, 5.0))),
        control=Box((Coordinate("u1", -5.0, 5.0), Coordinate("u2", 0.0, 17.0, scale=5.0))),
        constants={"arm": 0.2, "inertia": 0.05, "mass": 2.2, "weight": 4.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("x", -0.2, 0.2),)),
    cost_rate=None,
    terminal_cost=lambda x, s, c: x[6] / x[7] + 1000 * x[7],
    rest=np.zeros(8),
    goal=Goal([1, 0, 0, 0, 0, 0, FREE, FREE], radius=0.01, control=[0.0, 4.0]),
    duration=(0.3, 4.0),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=4.0,
)
CASE = Case(PROBLEM, [0.0], 1831.83)
