"""Plants on which plans are renewed: pushed at random times, with other constants, in a wind, or with a delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from moe_policy.rollouts.environments import Environments, base_of, environments
from ocp_envs.envs.options import EnvArguments
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

#: Standard deviations of a push, in the units of the coordinates; of any other problem a tenth of the scale.
PUSHES: Mapping[str, Mapping[str, float]] = {
    "PendulumSwingup-v0": {"omega": 0.5},
    "GroundVehicle-v0": {"theta": 0.2, "v": 1.0},
    "Quadcopter-v0": {"vx": 1.0, "vy": 1.0, "vz": 1.0},
    "QuadcopterObstacle-v0": {"vx": 1.0, "vy": 1.0, "vz": 1.0},
    "QuadcopterRecovery-v0": {"vx": 1.0, "vy": 1.0, "vz": 1.0},
}
#: Pushes in an episode, at times uniform over the duration of the optimal plan.
COUNT = 2


class Pushed(gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """Environments ``envs`` in which the state is moved.

    Before control step ``when`` (B, n) it is pushed by ``change`` (B, n, nx), before every one by ``steady`` (nx,).
    """

    def __init__(self, envs: Environments, when: NDArray[np.int64], change: Array, steady: Array) -> None:
        super().__init__(envs)
        self._when, self._change, self._steady, self._step = when, change, steady, 0

    def reset(self, **arguments: Any) -> Any:
        """Reset all episodes with the ``arguments`` of the environments."""
        self._step = 0
        return super().reset(**arguments)

    def step(self, actions: Array) -> Any:
        """One control step under ``actions`` (B, nu), after the pushes that are due."""
        due = (self._when == self._step)[..., None]
        base_of(self.env).push((self._change * due).sum(axis=1) + self._steady)
        self._step += 1
        return super().step(actions)


@dataclass(frozen=True, eq=False)
class Condition:
    """In what plants differ from the model under the name ``name``.

    The ``arguments`` are those of environments, ``wind`` is a steady change of the derivatives (nx,), ``pushed`` says
    whether there are pushes, and ``delay`` is known to methods that compensate for it, in control steps.
    """

    name: str
    arguments: EnvArguments
    wind: Array
    pushed: bool = False
    delay: int = 0

    def environments(self, problem: OptimalControlProblem, when: NDArray[np.int64], change: Array, dt: float) -> Pushed:
        """One plant of ``problem`` for each row of pushes ``when`` and ``change``, as for :class:`Pushed`.

        Control steps have ``dt`` seconds.
        """
        plants = environments(problem, len(when), dt, **self.arguments)
        return Pushed(plants, when, change * self.pushed, dt * self.wind)


def conditions(problem: OptimalControlProblem) -> list[Condition]:
    """The conditions under which plans of ``problem`` are renewed."""
    calm, names = np.zeros(problem.system.nx), problem.system.state.names
    found = [Condition("nominal", {}, calm), Condition("pushes", {}, calm, pushed=True)]
    constants = problem.system.constants
    for name, percent in (("mass", 10), ("speed_gain", -20)):
        if name in constants:
            changed = {name: constants[name] * (1 + percent / 100)}
            found.append(Condition(f"{name.replace('_', ' ')} {percent:+} %", {"constants": changed}, calm))
    if "vx" in names:
        wind = np.array([1.0 if name == "vx" else 0.0 for name in names])
        found.append(Condition("wind 1 m/s²", {}, wind))
    else:
        found.append(Condition("delay 60 ms", {"delay": 3}, calm, delay=3))
    return found


def deviations(problem: OptimalControlProblem) -> dict[str, float]:
    """Standard deviations of a push of ``problem``, by the name of the coordinate."""
    box = problem.system.state
    return dict(PUSHES.get(problem.id) or zip(box.names, (0.1 * box.scale).tolist()))


def pushes(problem: OptimalControlProblem, durations: Array, dt: float, seed: int) -> tuple[NDArray[np.int64], Array]:
    """Control steps (B, :data:`COUNT`) of ``dt`` seconds and changes (B, :data:`COUNT`, nx), drawn with ``seed``.

    Times are uniform over the ``durations`` (B,) of plans of ``problem``.
    """
    rng, told = np.random.default_rng(seed), deviations(problem)
    deviation = np.array([told.get(name, 0.0) for name in problem.system.state.names])
    when = np.floor(rng.uniform(0, 1, (len(durations), COUNT)) * durations[:, None] / dt).astype(np.int64)
    return when, rng.normal(0, 1, (len(durations), COUNT, problem.system.nx)) * deviation
