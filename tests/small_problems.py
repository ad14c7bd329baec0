"""Small problems with known answers, shared by the tests."""

import dataclasses

import casadi as ca
import numpy as np

from ocp_envs.goal import Goal, winding_modes
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Box, Coordinate, System

#: ẍ = u with |u| ≤ 1 to the origin, L = 1 + u²/2.
DOUBLE_INTEGRATOR = OptimalControlProblem(
    id="DoubleIntegrator-v0",
    title="move a mass and stop",
    system=System(
        name="double integrator",
        state=Box((Coordinate("x", -20.0, 20.0, "m"), Coordinate("v", -10.0, 10.0, "m/s"))),
        control=Box((Coordinate("u", -1.0, 1.0, "N"),)),
        constants={"mass": 1.0},
        dynamics=lambda x, u, c: [x[1], u[0] / c.mass],
    ),
    parameters=Box((Coordinate("x", -5.0, 5.0, "m"), Coordinate("v", -1.0, 1.0, "m/s"))),
    cost_rate=lambda x, u, s, c: 1 + u[0] ** 2 / 2,
    goal=Goal(state=[0.0, 0.0], radius=0.05, windings=[[0, 0]], control=[0.0]),
    duration=(0.2, 12.0),
    knots=21,
    substeps=1,
    hold=2.0,
    time_limit=15.0,
)

#: The same to a goal that is not held, with a wall at distance ``wall`` on the way as context.
WALLED_INTEGRATOR = OptimalControlProblem(
    id="WalledIntegrator-v0",
    title="move a mass and stop before a wall",
    system=DOUBLE_INTEGRATOR.system,
    parameters=Box((Coordinate("x", -5.0, 5.0, "m"), Coordinate("wall", -10.0, 10.0, "m"))),
    cost_rate=lambda x, u, s, c: 1 + u[0] ** 2 / 2,
    goal=Goal(state=[0.0, 0.0], radius=0.05, windings=[[0, 0]], control=[0.0]),
    duration=(0.2, 12.0),
    knots=21,
    substeps=1,
    hold=0.0,
    time_limit=15.0,
    clearance=lambda x, s, c: [ca.fabs(x[0] - s.wall) - 0.1],
)


def with_states(plans, where, values):
    """``plans`` with other states ``where`` an index of (row, knot, coordinate) says."""
    states = plans.states.copy()
    states[where] = values
    return dataclasses.replace(plans, states=states)


def rest_to_rest(starts: np.ndarray, duration: float, knots: int):
    """Exact bang-bang-free plans of the double integrator from (x_0, 0) to the origin: two opposite constant forces.

    Returns states (B, N, 2), controls (B, N-1, 1), duration (B,); N odd, so that the switch is a knot.
    """
    assert knots % 2 == 1
    half = duration / 2
    force = -starts / half**2
    t = np.linspace(0, duration, knots)
    late = np.maximum(t - half, 0)
    x = starts[:, None] + force[:, None] * (t**2 / 2 - late**2)
    v = force[:, None] * (t - 2 * late)
    u = np.repeat(np.stack([force, -force], axis=1), (knots - 1) // 2, axis=1)[..., None]
    return np.stack([x, v], axis=-1), u, np.full(len(starts), duration)


#: The double integrator to the origin with L = u²/2 and controls that never reach their bounds: linear and quadratic.
#: Longer is cheaper, so that every plan takes the longest time; near the origin hardly, so that all times are long.
LINEAR_QUADRATIC = dataclasses.replace(
    DOUBLE_INTEGRATOR,
    id="LinearQuadratic-v0",
    system=dataclasses.replace(DOUBLE_INTEGRATOR.system, control=Box((Coordinate("u", -5.0, 5.0, "N"),))),
    cost_rate=lambda x, u, s, c: u[0] ** 2 / 2,
    duration=(4.99, 5.0),
)

#: θ̈ = u with |u| ≤ 1 until a body faces the other way: it turns left or right, which is not declared.
TURN = OptimalControlProblem(
    id="Turn-v0",
    title="turn round",
    system=System(
        name="body",
        state=Box(
            (
                Coordinate("theta", -3 * np.pi, 3 * np.pi, "rad", period=2 * np.pi),
                Coordinate("omega", -10.0, 10.0, "rad/s"),
            )
        ),
        control=Box((Coordinate("u", -1.0, 1.0, "N"),)),
        constants={"inertia": 1.0},
        dynamics=lambda x, u, c: [x[1], u[0] / c.inertia],
    ),
    parameters=Box((Coordinate("theta", -np.pi, np.pi, "rad"), Coordinate("omega", -0.5, 0.5, "rad/s"))),
    cost_rate=lambda x, u, s, c: 1 + u[0] ** 2 / 2,
    goal=Goal(state=[np.pi, 0.0], radius=0.05, windings=[[0, 0], [-1, 0]], control=[0.0]),
    duration=(0.2, 12.0),
    knots=21,
    substeps=1,
    hold=2.0,
    time_limit=15.0,
)

#: The same with the two sides as solution families.
TURNING = dataclasses.replace(TURN, modes=winding_modes(("right", "left")))
