"""What a plant that differs from the model does to policies: perturbations as data, and runs along their levels.

Planners and policies know the nominal problem only. The plant differs from it in one respect at a time:

- *mismatch*: constants of the dynamics are (1 + level) times their nominal values;
- *disturbance*: normal accelerations of standard deviation ``level``, drawn anew for each tick, on the velocities;
- *noise*: normal errors of the observed state, of ``level`` times the scale of each coordinate;
- *delay*: controls act ``level`` ticks late.

Every level is a set of arguments of the environments (:class:`ocp_envs.Env`), so all run through the common loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from moe_policy.comparison import Contestant
from moe_policy.evaluation import evaluate
from moe_policy.rollout import environments, rollout
from moe_policy.scaling import Array
from ocp_envs.problem import OptimalControlProblem

KINDS = ("mismatch", "disturbance", "noise", "delay")
_RELATIVE = (-0.3, -0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2, 0.3)
_NOISE = (0.0, 0.001, 0.003, 0.01, 0.03, 0.1)
_DELAYS = (0, 1, 2, 3, 5, 8, 12)


@dataclass(frozen=True)
class Perturbation:
    """One respect in which the plant differs from the model.

    Args:
        name: short name, for records.
        label: what the axis of a figure says, with the unit.
        kind: one of :data:`KINDS`.
        levels: increasing, 0 (the nominal plant) among them.
        names: constants that change (mismatch), or state coordinates that are disturbed.

    Raises:
        ValueError: an unknown kind, or levels without 0 or out of order.
    """

    name: str
    label: str
    kind: str
    levels: tuple[float, ...]
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.name}: expected a kind of {KINDS}, got {self.kind!r}")
        if 0 not in self.levels or list(self.levels) != sorted(set(self.levels)):
            raise ValueError(f"{self.name}: expected increasing levels with 0 among them, got {self.levels}")

    def arguments(self, problem: OptimalControlProblem, level: float) -> dict[str, Any]:
        """Arguments of the environment at ``level``; none at 0.

        Raises:
            ValueError: a constant or coordinate that the problem does not have.
        """
        there = problem.system.constants if self.kind == "mismatch" else problem.system.state.names
        if unknown := [name for name in self.names if name not in there]:
            raise ValueError(f"{problem.id} has no {unknown}; there are {sorted(there)}")
        if level == 0:
            return {}
        if self.kind == "mismatch":
            return {"constants": {name: (1 + level) * problem.system.constants[name] for name in self.names}}
        if self.kind == "disturbance":
            return {"disturbance": level * np.isin(problem.system.state.names, self.names)}
        if self.kind == "noise":
            return {"observation_noise": level * problem.system.state.scale}
        return {"delay": int(level)}


def _mismatch(name: str, *constants: str) -> Perturbation:
    return Perturbation(name, f"{name}, relative error", "mismatch", _RELATIVE, constants)


def _disturbance(levels: tuple[float, ...], unit: str, *coordinates: str) -> Perturbation:
    return Perturbation("disturbance", f"random acceleration, {unit}", "disturbance", levels, coordinates)


_COMMON = (
    Perturbation("noise", "measurement noise, parts of the state's scale", "noise", _NOISE),
    Perturbation("delay", "control delay, ticks", "delay", tuple(map(float, _DELAYS))),
)
_QUADCOPTER = (
    _mismatch("mass", "mass"),
    _mismatch("inertia", "inertia_x", "inertia_y", "inertia_z"),
    _disturbance((0.0, 0.5, 1.0, 2.0, 5.0, 10.0), "m/s²", "vx", "vy", "vz"),
    *_COMMON,
)
PERTURBATIONS: Mapping[str, tuple[Perturbation, ...]] = MappingProxyType(
    {
        "PendulumSwingup-v0": (
            _mismatch("mass", "mass"),
            _mismatch("torque", "torque_gain"),
            _disturbance((0.0, 0.1, 0.2, 0.5, 1.0, 2.0), "rad/s²", "omega"),
            *_COMMON,
        ),
        "GroundVehicle-v0": (
            _mismatch("steering", "steering_gain"),
            _mismatch("acceleration", "speed_gain"),
            _disturbance((0.0, 0.2, 0.5, 1.0, 2.0, 5.0), "m/s²", "v"),
            *_COMMON,
        ),
        "Quadcopter-v0": _QUADCOPTER,
        "QuadcopterObstacle-v0": _QUADCOPTER,
    }
)


def perturbations_of(problem: OptimalControlProblem) -> tuple[Perturbation, ...]:
    """The perturbations of ``problem``: for one of the user's own every constant by itself, noise and delay."""
    if problem.id in PERTURBATIONS:
        return PERTURBATIONS[problem.id]
    return (*(_mismatch(name, name) for name, value in problem.system.constants.items() if value), *_COMMON)


def run_level(
    problem: OptimalControlProblem,
    contestants: Sequence[Contestant],
    starts: Array,
    perturbation: Perturbation,
    level: float,
    *,
    seed: int = 0,
    dt: float = 0.02,
) -> list[dict[str, Any]]:
    """How each contestant does from ``starts`` (B, np) under one level, a record each.

    Args:
        problem: the nominal problem, which planners plan for.
        contestants: who acts; names must differ.
        starts: parameters of the episodes.
        perturbation: of the plant.
        level: one of its levels.
        seed: of noise and disturbances, the same for every contestant.
        dt: control period, seconds.
    """
    rows = []
    for contestant in contestants:
        envs = environments(problem, len(starts), dt, **perturbation.arguments(problem, level))
        envs.reset(seed=seed)  # rollout itself does not seed
        metrics = evaluate(problem, rollout(envs, contestant.policy(problem, dt), starts)).record()
        envs.close()
        kept = ("reached", "success", "success_at_plan_end", "left_box", "violation_mean", "knot_violation_mean")
        rows.append(
            {"name": contestant.name, "perturbation": perturbation.name, "level": level}
            | {key: metrics[key] for key in kept}
        )
    return rows
