"""What a plant that differs from the model does to policies: perturbations as data, and runs along their levels.

Planners and policies know the nominal problem only. The plant differs from it in one respect at a time:

- *mismatch* of e %: constants of the dynamics are 1 + e/100 times their nominal values, or are divided by that;
- *disturbance*: normal accelerations of standard deviation ``level``, drawn anew for each tick, added to v̇;
- *noise* of e %: normal errors of the observed state, of e/100 times the scale of each coordinate;
- *delay*: controls act ``level`` milliseconds late, a whole number of ticks; until then the control of the goal acts.

Every level is a set of arguments of the environments (:class:`ocp_envs.Env`), so all run through the common loop. The
constants that change are those of the problem's declaration, and where no single one says what is meant, several do:

    pendulum    ω̇ = (τ u − m g l sin θ) / (m l²): twice the inertia, under the same torques, is l → 2 l, m → m/2;
                twice the mass is half the torque, as the pull of gravity grows with the mass;
    quadcopter  rotors that give κ times the thrust, and so κ times its moments, are m → m/κ, l → κ l, k → κ k.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from moe_policy.experiments.comparison import Method
from moe_policy.rollouts.metrics import evaluate
from moe_policy.rollouts.rollout import environments, rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

KINDS = ("mismatch", "disturbance", "noise", "delay")
#: What is kept of the metrics of a level.
FIGURES = ("reached", "success", "success_at_plan_end", "left_box", "violation_mean", "knot_violation_mean")


@dataclass(frozen=True)
class Perturbation:
    """One respect in which the plant differs from the model.

    Args:
        name: short name, for records.
        label: what differs, as the axis of a figure says it.
        unit: of the levels.
        kind: one of :data:`KINDS`.
        levels: increasing, in ``unit``, 0 (the nominal plant) among them.
        names: constants that are multiplied (mismatch), or state coordinates that are disturbed.
        divided: constants that are divided (mismatch).

    Raises:
        ValueError: an unknown kind, levels without 0 or out of order, or levels that the kind cannot have.
    """

    name: str
    label: str
    unit: str
    kind: str
    levels: tuple[float, ...]
    names: tuple[str, ...] = ()
    divided: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.name}: expected a kind of {KINDS}, got {self.kind!r}")
        if 0 not in self.levels or list(self.levels) != sorted(set(self.levels)):
            raise ValueError(f"{self.name}: expected increasing levels with 0 among them, got {self.levels}")
        if self.levels[0] <= -100 or (self.levels[0] < 0 and self.kind != "mismatch"):
            bound = "above -100 %" if self.kind == "mismatch" else "of 0 or more"
            raise ValueError(f"{self.name}: expected levels {bound}, got {self.levels}")

    def arguments(self, problem: OptimalControlProblem, level: float, dt: float = 0.02) -> dict[str, Any]:
        """Arguments of the environment at ``level``, for a control period of ``dt`` seconds; none at 0.

        Raises:
            ValueError: a constant or coordinate that the problem does not have, or a delay between ticks.
        """
        there = problem.system.constants if self.kind == "mismatch" else problem.system.state.names
        if unknown := [name for name in (*self.names, *self.divided) if name not in there]:
            raise ValueError(f"{problem.id} has no {unknown}; there are {sorted(there)}")
        if level == 0:
            return {}
        if self.kind == "mismatch":
            constants, factor = problem.system.constants, 1 + level / 100
            changed = {name: constants[name] * factor for name in self.names}
            return {"constants": changed | {name: constants[name] / factor for name in self.divided}}
        if self.kind == "disturbance":
            return {"disturbance": level * np.isin(problem.system.state.names, self.names)}
        if self.kind == "noise":
            return {"observation_noise": level / 100 * problem.system.state.scale}
        ticks = level / (1000 * dt)
        if abs(ticks - round(ticks)) > 1e-6:
            raise ValueError(f"{self.name}: expected whole ticks of {1000 * dt:g} ms, got {level:g} ms")
        return {"delay": round(ticks)}


# -- the perturbations of each problem ---------------------------------------------------------------------------------

_WIDE = (-30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0)


def _mismatch(
    name: str, *constants: str, divided: tuple[str, ...] = (), levels: tuple[float, ...] = _WIDE
) -> Perturbation:
    return Perturbation(name, f"{name}, plant against model", "%", "mismatch", levels, constants, divided)


def _disturbance(unit: str, *coordinates: str, levels: tuple[float, ...]) -> Perturbation:
    return Perturbation("disturbance", "random acceleration", unit, "disturbance", levels, coordinates)


def _common(noise: tuple[float, ...], delay: tuple[float, ...]) -> tuple[Perturbation, ...]:
    return (
        Perturbation("noise", "measurement noise, parts of the state's scale", "%", "noise", noise),
        Perturbation("delay", "control delay", "ms", "delay", delay),
    )


_NOISE = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
_DELAY = (0.0, 20.0, 40.0, 60.0, 100.0, 160.0, 240.0)
#: Nothing integrates the error while it hovers, so a few per cent more weight, or less thrust, leave it off the goal.
_LIFT = (-30.0, -20.0, -10.0, -5.0, -2.0, -1.0, 0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
_QUADCOPTER = (
    _mismatch("mass", "mass", levels=_LIFT),
    _mismatch("inertia", "inertia_x", "inertia_y", "inertia_z"),
    _mismatch("thrust", "arm", "moment_ratio", divided=("mass",), levels=_LIFT),
    _disturbance("m/s²", "vx", "vy", "vz", levels=(0.0, 0.5, 1.0, 2.0, 5.0, 10.0)),
    *_common(_NOISE, _DELAY),
)
PERTURBATIONS: Mapping[str, tuple[Perturbation, ...]] = MappingProxyType(
    {
        "PendulumSwingup-v0": (
            _mismatch("mass", "mass"),
            _mismatch("inertia", "length", divided=("mass",)),
            _mismatch("torque", "torque_gain"),
            _disturbance("rad/s²", "omega", levels=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0)),
            *_common(_NOISE, _DELAY),
        ),
        "GroundVehicle-v0": (
            _mismatch("steering gain", "steering_gain"),
            _mismatch("speed gain", "speed_gain"),
            _disturbance("m/s²", "v", levels=(0.0, 0.2, 0.5, 1.0, 2.0, 5.0)),
            *_common(_NOISE, _DELAY),
        ),
        "Quadcopter-v0": _QUADCOPTER,
        "QuadcopterObstacle-v0": _QUADCOPTER,
    }
)


def perturbations_of(problem: OptimalControlProblem) -> tuple[Perturbation, ...]:
    """The perturbations of ``problem``: for one of the user's own every constant by itself, noise and delay."""
    if problem.id in PERTURBATIONS:
        return PERTURBATIONS[problem.id]
    own = [_mismatch(name, name) for name, value in problem.system.constants.items() if value]
    return (*own, *_common(_NOISE, _DELAY))


# -- running -----------------------------------------------------------------------------------------------------------


def level_key(identity: str, arguments: Mapping[str, Any]) -> str:
    """A short name for what a level's figures depend on.

    Args:
        identity: names all but the plant: problem, methods, starts, seed and control period.
        arguments: of the environment. The nominal plants of all perturbations are one level.
    """
    told = json.dumps([identity, arguments], sort_keys=True, default=lambda values: values.tolist())
    return hashlib.sha256(told.encode()).hexdigest()[:16]


def run_level(
    problem: OptimalControlProblem,
    methods: Sequence[Method],
    starts: Array,
    arguments: Mapping[str, Any],
    *,
    seed: int = 0,
    dt: float = 0.02,
) -> list[dict[str, Any]]:
    """How each method does from ``starts`` (B, np) on one plant: its name and :data:`FIGURES`, a record each.

    Args:
        problem: the nominal problem, which planners plan for.
        methods: who acts; names must differ.
        starts: parameters of the episodes.
        arguments: of :meth:`Perturbation.arguments`.
        seed: of noise and disturbances. They are drawn for each episode by itself, so that the same episode meets the
            same draws whoever acts, and at another level the same ones times another factor.
        dt: control period, seconds.
    """
    rows = []
    for method in methods:
        envs = environments(problem, len(starts), dt, **arguments)
        envs.reset(seed=seed)  # rollout itself does not seed
        metrics = evaluate(problem, rollout(envs, method.policy(problem, dt), starts)).record()
        envs.close()
        rows.append({"name": method.name} | {key: metrics[key] for key in FIGURES})
    return rows
