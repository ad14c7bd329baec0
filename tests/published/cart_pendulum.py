"""The swing-up of a pendulum on a cart in the least time, with bounds of the cart's position and velocity.

OptimalControlProblems.jl, cart_pendulum: 1.743966 s with 500 intervals. The collection leaves the initial velocity of
the cart free, and a constant ``a`` of its equations of motion; both are parameters here, at their best values.
"""

import casadi as ca
import numpy as np

from ocp_envs import FREE, Box, Coordinate, Goal, OptimalControlProblem, System
from tests.published.case import Case


def dynamics(x, u, c):
    _, v, theta, omega = x

    def turn(a):
        return c.length * c.pole / 2 / (c.pole * c.length**2 / 3) * (-a * ca.cos(theta) - c.gravity * ca.sin(theta))

    push = c.pole * (c.length * (-omega * ca.sin(theta) + ca.cos(theta) * turn(c.a) / 2) + c.a)
    rate = 2 * c.a + (push - u[0]) / c.cart
    return [v, rate, omega, turn(rate)]


PROBLEM = OptimalControlProblem(
    id="CartPendulum-v0",
    title="swing up in the least time",
    system=System(
        name="cart and pendulum",
        state=Box(
            (
                Coordinate("x", -1.0, 1.0, "m"),
                Coordinate("v", -2.0, 2.0, "m/s"),
                Coordinate("theta", -6.0, 6.0, "rad"),
                Coordinate("omega", -15.0, 15.0, "rad/s", scale=5.0),
            )
        ),
        control=Box((Coordinate("force", -5.0, 5.0, "N", scale=5.0),)),
        constants={"gravity": 9.81, "length": 1.0, "pole": 1.0, "cart": 0.5, "a": 0.0},
        dynamics=dynamics,
    ),
    parameters=Box((Coordinate("v", -2.0, 2.0, "m/s"), Coordinate("a", -20.0, 20.0))),
    cost_rate=lambda x, u, s, c: 1,
    rest=[0.0, 0.0, 0.0, 0.0],
    goal=Goal([FREE, FREE, np.pi, 0.0], radius=0.1),
    duration=(0.2, 4.0),
    knots=101,
    substeps=1,
    hold=0.0,
    time_limit=4.0,
)
CASE = Case(PROBLEM, [-0.95116, -0.03859], 1.743966)
