"""Two masses on springs under a periodic force, damped by a control: time in the dynamics.

OptimalControlProblems.jl, double_oscillator: 9.10923e-4 with 500 intervals (Coudurier, Lepreux & Petit, *Optimal
bang-bang control of a mechanical double oscillator*, 2018). The collection leaves the initial velocities free; they are
parameters here, at their best values.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    x1, x2, v1, v2, t = x
    return [
        v1,
        v2,
        (-(c.k1 + c.k2) * x1 + c.k2 * x2 + ca.sin(t)) / c.m1,
        (c.k2 * (x1 - x2) - c.damping * (1 - u[0]) * v2) / c.m2,
        1,
    ]


SMALL = [Coordinate(name, -1.0, 1.0, unit, scale=0.01) for name, unit in zip(("x1", "x2", "v1", "v2"), "mmss")]
PROBLEM = OptimalControlProblem(
    id="DoubleOscillator-v0",
    title="damp two masses",
    system=System(
        name="double oscillator",
        state=Box((*SMALL, Coordinate("t", 0.0, 7.0, "s"))),
        control=Box((Coordinate("u", -1.0, 1.0, scale=0.01),)),
        constants={"m1": 100.0, "m2": 2.0, "damping": 0.5, "k1": 100.0, "k2": 3.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("v1", -0.1, 0.1), Coordinate("v2", -0.1, 0.1))),
    cost_rate=lambda x, u, s, c: (x[0] ** 2 + x[1] ** 2 + u[0] ** 2) / 2,
    rest=np.zeros(5),
    goal=Goal([FREE] * 5),
    duration=(2 * np.pi, 2 * np.pi),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=2 * np.pi,
)
CASE = Case(PROBLEM, [-0.0043146, 0.0146345], 9.10923e-4)
