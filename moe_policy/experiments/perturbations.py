"""In what respects a plant differs from the model that planners and policies know: one perturbation at a time.

- *mismatch* of e %: constants of the dynamics are multiplied by 1 + e/100, or divided by it;
- *disturbance*: normal accelerations of standard deviation ``level``, drawn for each control step, added to v̇;
- *noise* of e %: normal errors of the observed state, of e/100 times the scale of each coordinate;
- *delay*: controls act ``level`` milliseconds late, a whole number of control steps; until then the control of the goal
  acts.

The constants that change are those of the problem's declaration. Where no single one has the physical meaning, several
change together:

    pendulum    ω̇ = (τ u − m g l sin θ) / (m l²): twice the inertia, under the same torques, is l → 2 l, m → m/2;
                twice the mass is half the torque, as the torque of gravity grows with the mass;
    quadcopter  rotors with κ times the thrust, and so κ times its moments, are m → m/κ, l → κ l, k → κ k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.envs.options import EnvArguments
from ocp_envs.problem import OptimalControlProblem

KINDS = ("mismatch", "disturbance", "noise", "delay")


@dataclass(frozen=True)
class Perturbation:
    """One respect in which the plant differs from the model.

    Raises:
        ValueError: an unknown kind, levels without 0 or out of order, or levels that the kind cannot have.
    """

    name: str  # short name, for records
    label: str  # what differs, as the axis of a figure says it
    unit: str  # of the levels
    kind: str  # one of :data:`KINDS`
    levels: tuple[float, ...]  # increasing, in ``unit``, 0 (the nominal plant) among them
    names: tuple[str, ...] = ()  # constants that are multiplied (mismatch), or state coordinates that are disturbed
    divided: tuple[str, ...] = ()  # constants that are divided (mismatch)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.name}: expected a kind of {KINDS}, got {self.kind!r}")
        if 0 not in self.levels or list(self.levels) != sorted(set(self.levels)):
            raise ValueError(f"{self.name}: expected increasing levels with 0 among them, got {self.levels}")
        if self.levels[0] <= -100 or (self.levels[0] < 0 and self.kind != "mismatch"):
            bound = "above -100 %" if self.kind == "mismatch" else "of 0 or more"
            raise ValueError(f"{self.name}: expected levels {bound}, got {self.levels}")

    def arguments(self, problem: OptimalControlProblem, level: float, dt: float = 0.02) -> EnvArguments:
        """Arguments of the environment at ``level`` with the control period ``dt``, seconds; none at level 0.

        Raises:
            ValueError: a constant or coordinate that the problem lacks, a constant that is one of its parameters, or a
                delay that is no multiple of ``dt``.
        """
        there = problem.system.constants if self.kind == "mismatch" else problem.system.state.names
        if unknown := [name for name in (*self.names, *self.divided) if name not in there]:
            raise ValueError(f"{problem.id} has no {unknown}; there are {sorted(there)}")
        if given := [name for name in (*self.names, *self.divided) if name in problem.context.names]:
            raise ValueError(f"{problem.id}: {given} are parameters, known to every planner: no mismatch of the plant")
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
        steps = level / (1000 * dt)
        if abs(steps - round(steps)) > 1e-6:
            raise ValueError(
                f"{self.name}: expected a multiple of the control period of {1000 * dt:g} ms, got {level:g} ms"
            )
        return {"delay": round(steps)}


_WIDE = (-30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0)
#: Measurement noise and control delay, which every problem has.
SENSING = (
    Perturbation(
        "noise", "measurement noise, parts of the state's scale", "%", "noise", (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
    ),
    Perturbation("delay", "control delay", "ms", "delay", (0.0, 20.0, 40.0, 60.0, 100.0, 160.0, 240.0)),
)


def mismatch(
    name: str, *constants: str, divided: tuple[str, ...] = (), levels: tuple[float, ...] = _WIDE
) -> Perturbation:
    """Constants, and others that are ``divided``, that together differ by some per cent as ``name`` says."""
    return Perturbation(name, f"{name}, plant against model", "%", "mismatch", levels, constants, divided)


def disturbance(unit: str, *coordinates: str, levels: tuple[float, ...]) -> Perturbation:
    """Random accelerations of standard deviations ``levels``, added to the derivatives of ``coordinates``."""
    return Perturbation("disturbance", "random acceleration", unit, "disturbance", levels, coordinates)


def of_every_constant(problem: OptimalControlProblem) -> tuple[Perturbation, ...]:
    """Perturbations of any ``problem``: noise, delay and a mismatch of constants that are neither 0 nor parameters."""
    constants = {name: value for name, value in problem.system.constants.items() if name not in problem.context.names}
    return (*(mismatch(name, name) for name, value in constants.items() if value), *SENSING)
