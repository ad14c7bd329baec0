"""Swing-up of a pendulum of any mass with a motor of any strength: the pendulum of :mod:`ocp_envs.problems.pendulum`
with two of its constants among the parameters.

    θ̇ = ω,   ω̇ = (τ u − m g l sin θ) / (m l²),   L = 1 + u²,   p = (θ_0, ω_0, m, τ)

Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts*, name model uncertainties as
future work. The largest torque τ is 0.54 to 1.86 times what holds the pendulum horizontal: a strong motor lifts it
without a swing, a weak one needs several, so the discontinuities move with m and τ. Planners and regulators are given
both; a plant that differs from what they are given has another ``length`` or ``gravity``.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ocp_envs.picture import Ball, Line, Picture, Shape
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate


def _body(state: Array, context: Array) -> list[Shape]:
    """The pendulum; the area of its bob is as its mass, that of the motor as its torque."""
    mass, torque = np.sqrt(context)
    tip = np.array([np.sin(state[0]), -np.cos(state[0])])
    return [
        Line(np.array([[0.0, 0.0], tip]), width=6, color="#8c4a2f"),
        Ball(tip, 0.14 * float(mass), color="#8c4a2f"),
        Ball(np.zeros(2), 0.10 * float(torque), color="#1f4e79"),
    ]


def _path(states: Array) -> Array:
    return np.stack([np.sin(states[:, 0]), -np.cos(states[:, 0])], axis=1)


UNCERTAIN_PENDULUM = dataclasses.replace(
    PENDULUM,
    id="PendulumUncertain-v0",
    title="swing up a pendulum of any mass with a motor of any strength",
    parameters=Box(
        (
            *PENDULUM.parameters.coordinates,
            Coordinate("mass", 0.7, 1.3, "kg"),
            Coordinate("torque_gain", 0.7, 1.3),
        )
    ),
    duration=(0.1, 10.0),
    knots=31,
    picture=Picture(limits=((-1.3, 1.3), (-1.3, 1.3)), body=_body, path=_path),
)
