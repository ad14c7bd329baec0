"""The options of an environment, validated: its problem and the keyword arguments of :class:`ocp_envs.envs.env.Env`."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, TypedDict

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.envs.interface import Interface
from ocp_envs.envs.outcome import Info
from ocp_envs.envs.simulation import Simulator, largest_cost_rate
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import BENCHMARK, problem_of
from ocp_envs.support.arrays import Array, Ints, frozen_array
from ocp_envs.support.clock import count_steps
from ocp_envs.support.doors import checked
from ocp_envs.support.suggestions import did_you_mean

RENDER_MODES = ("rgb_array", "human")
#: Name, smallest and largest value of a constant.
Side = tuple[str, float, float]
#: Control steps of an episode; an index of more is no longer exact in float arithmetic of times.
MOST_STEPS = 1e9


class EnvArguments(TypedDict, total=False):
    """Keyword arguments of an environment, apart from its control period."""

    terminate_at_goal: bool
    time_limit: float | None
    max_episode_steps: int | None
    constants: Mapping[str, ArrayLike] | None
    disturbance: ArrayLike
    observation_noise: ArrayLike
    delay: int
    render_mode: str | None


@lru_cache(maxsize=32)
def _plant(
    problem: OptimalControlProblem, constants: tuple[tuple[str, float], ...], varied: tuple[Side, ...], dt: float
) -> Simulator:
    plant = problem.with_constants(**dict(constants))
    return Simulator(plant.with_varied(**{name: sides for name, *sides in varied}), dt)


def refuse_unknown(environment: type, unknown: Mapping[str, object]) -> None:
    """Refuse keyword arguments ``unknown`` to the signature of the class ``environment`` with a ``TypeError``."""
    for name in unknown:
        parameters = inspect.signature(environment).parameters.values()
        accepted = [parameter.name for parameter in parameters if parameter.kind is not parameter.VAR_KEYWORD]
        hint = did_you_mean(name, accepted)
        raise TypeError(f"{environment.__name__}: unknown argument {name!r}; {hint}accepted are {accepted}")


@checked
@dataclass(frozen=True, eq=False)
class EnvOptions:
    """The options of an environment, as :class:`~ocp_envs.envs.env.Env` documents them.

    Args:
        problem, dt, terminate_at_goal, max_episode_steps, delay, render_mode: see there.
        time_limit: see there; kept is a number.
        constants: see there; kept is a mapping.
        disturbance, observation_noise: see there; kept are standard deviations (nx,).

    Raises:
        ValueError: an option out of its range; the message names it.
    """

    problem: OptimalControlProblem
    dt: float = 0.02
    terminate_at_goal: bool = True
    time_limit: float | None = None
    max_episode_steps: int | None = None
    constants: Mapping[str, ArrayLike] | None = None
    disturbance: ArrayLike = 0.0
    observation_noise: ArrayLike = 0.0
    delay: int = 0
    render_mode: str | None = None

    def __post_init__(self) -> None:
        given = {name: self._constant(name, value) for name, value in (self.constants or {}).items()}
        object.__setattr__(self, "constants", MappingProxyType(given))
        problem = self.simulator.problem  # raises for a bad dt or constant
        limit = problem.time_limit if self.time_limit is None else float(self.time_limit)
        if not (math.isfinite(limit) and limit > 0):
            raise ValueError(f"{problem.id}: time_limit must be a positive number of seconds, got {self.time_limit}")
        if limit / self.dt > MOST_STEPS:
            raise ValueError(
                f"{problem.id}: time_limit = {limit:g} s and dt = {self.dt:g} s make more than {MOST_STEPS:g} control "
                "steps; both are in seconds"
            )
        object.__setattr__(self, "time_limit", limit)
        steps = self.max_episode_steps
        if steps == 0:
            raise ValueError(f"{problem.id}: max_episode_steps must be a positive number of control steps, got 0")
        for name in ("disturbance", "observation_noise"):
            object.__setattr__(self, name, self._deviations(name))
        if self.render_mode is not None and self.render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode must be None or one of {RENDER_MODES}, got {self.render_mode!r}")
        if self.render_mode is not None and problem.picture is None:
            raise ValueError(f"{problem.id} has no picture, so it cannot be rendered; leave render_mode at None")

    def _deviations(self, name: str) -> Array:
        """The standard deviations of an option, (nx,)."""
        box = self.problem.system.state
        values = np.asarray(getattr(self, name), dtype=np.float64)
        if values.shape not in ((), (len(box),)) or not np.isfinite(values).all() or (values < 0).any():
            raise ValueError(
                f"{self.problem.id}: {name} must be standard deviations ≥ 0, one number or {len(box)} "
                f"({', '.join(box.names)}), got {getattr(self, name)!r}"
            )
        return frozen_array(np.broadcast_to(values, (len(box),)))

    def __reduce__(self) -> tuple[object, ...]:
        values = {f.name: getattr(self, f.name) for f in fields(self)} | {"constants": dict(self.constants or {})}
        # Any process knows the problems of the benchmark by their names; others travel by value, registered or not.
        if self.problem in BENCHMARK:
            values["problem"] = self.problem.id
        return _restore, tuple(values.values())

    @cached_property
    def simulator(self) -> Simulator:
        """The plant: the problem under ``constants``, shared by equal options."""
        same = {name: np.asarray(value).item() for name, value in (self.constants or {}).items() if np.ndim(value) == 0}
        varied = [(name, float(values.min()), float(values.max())) for name, values in self.varied.items()]
        return _plant(self.problem, tuple(sorted(same.items())), tuple(varied), self.dt)

    @property
    def varied(self) -> dict[str, Array]:
        """The constants that differ between the rows of a vector environment, (num_envs,) by name."""
        return {name: np.asarray(value) for name, value in sorted((self.constants or {}).items()) if np.ndim(value)}

    def _constant(self, name: str, value: ArrayLike) -> ArrayLike:
        """A number, or a read-only array (num_envs,), for the constant ``name``."""
        array = np.asarray(value, dtype=np.float64)
        if array.ndim > 1 or not array.size or not np.isfinite(array).all():
            raise ValueError(
                f"{self.problem.id}: constants[{name!r}] must be a finite number, or one for each environment, got "
                f"{value!r}"
            )
        return frozen_array(array) if array.ndim else float(array)

    @property
    def metadata(self) -> Info:
        """Gymnasium's metadata: the render modes, none without a picture, and one frame for each control step."""
        modes = [] if self.problem.picture is None else list(RENDER_MODES)
        return {"render_modes": modes, "render_fps": max(1, round(1 / self.dt))}

    @cached_property
    def steps_to_limit(self) -> int:
        """Control steps to the time limit."""
        assert self.time_limit is not None
        return int(count_steps(self.time_limit, self.dt))

    @cached_property
    def max_steps(self) -> int:
        """Control steps after which an episode is truncated."""
        return min(self.steps_to_limit, self.max_episode_steps or self.steps_to_limit)

    @cached_property
    def disturbed(self) -> bool:
        """Whether there is a disturbance."""
        return bool(np.any(self.disturbance))

    @cached_property
    def noisy(self) -> bool:
        """Whether there is observation noise."""
        return bool(np.any(self.observation_noise))

    @cached_property
    def interface(self) -> Interface:
        """What a policy must know of the environment."""
        return Interface.of(self.problem, float(self.dt))

    @property
    def observation_space(self) -> gym.spaces.Box:
        """See :class:`~ocp_envs.envs.interface.Interface`."""
        return self.interface.observation_space

    @property
    def action_space(self) -> gym.spaces.Box:
        """The control box."""
        return self.interface.action_space

    def charge(self, steps: int | Ints) -> float | NDArray[np.floating]:
        """Cost charged for leaving the box after ``steps`` control steps: the largest in the time to its limit."""
        return largest_cost_rate(self.problem) * self.dt * (self.steps_to_limit - steps)

    def draw_parameters(self, generators: Sequence[np.random.Generator]) -> Array:
        """Parameters (B, np) from the distribution of the problem, one from each of B ``generators``."""
        return self.problem.distribution.draw(self.problem, generators)


def _restore(problem: OptimalControlProblem | str, *values: Any) -> EnvOptions:
    return EnvOptions(problem_of(problem), *values)
