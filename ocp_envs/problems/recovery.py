"""Quadcopter that recovers from any state of motion and comes to rest: the full state is the parameter.

The model, the goal and the cost L = 10 + ‖v‖² + 0.1 ‖(φ, θ, ψ)‖² + ‖(p, q, r)‖² + ‖u‖² are those of
:mod:`ocp_envs.problems.quadcopter`; the initial state has a velocity, an attitude and body rates, as after a push. A
planner for this problem can therefore plan again at any time during a flight. The box of initial states is a decision
of this project.
"""

from __future__ import annotations

import dataclasses

from ocp_envs.problems.quadcopter import QUADCOPTER, START
from ocp_envs.system import Box, Coordinate

QUADCOPTER_RECOVERY = dataclasses.replace(
    QUADCOPTER,
    id="QuadcopterRecovery-v0",
    title="recover a quadcopter from any motion and bring it to rest",
    parameters=Box(
        (
            *START,
            *(Coordinate(n, -3.0, 3.0, "m/s") for n in ("vx", "vy", "vz")),
            *(Coordinate(n, -0.6, 0.6, "rad") for n in ("phi", "theta")),
            Coordinate("psi", -1.0, 1.0, "rad"),
            *(Coordinate(n, -2.0, 2.0, "rad/s") for n in ("p", "q", "r")),
        )
    ),
    duration=(0.3, 10.0),
)
