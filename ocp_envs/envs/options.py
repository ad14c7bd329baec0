"""What an environment is built from: a problem and the arguments that :class:`ocp_envs.envs.env.Env` documents."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.envs.simulation import Simulator, largest_cost_rate
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import UnknownProblemError, load
from ocp_envs.support.arrays import Array, frozen_array
from ocp_envs.support.clock import count_steps
from ocp_envs.support.suggestions import did_you_mean

RENDER_MODES = ("rgb_array", "human")


@lru_cache(maxsize=32)
def _plant(problem: OptimalControlProblem, constants: tuple[tuple[str, float], ...], dt: float) -> Simulator:
    return Simulator(problem.with_constants(**dict(constants)), dt)


@dataclass(frozen=True, eq=False)
class Settings:
    """What both environments are built from: the problem and the arguments of :class:`Env`."""

    problem: OptimalControlProblem
    dt: float = 0.02
    terminate_at_goal: bool = True
    time_limit: float | None = None
    constants: Mapping[str, float] = field(default_factory=dict)
    disturbance: Any = 0.0
    observation_noise: Any = 0.0
    delay: int = 0
    render_mode: str | None = None

    def __post_init__(self) -> None:
        if isinstance(self.problem, str):
            object.__setattr__(self, "problem", load(self.problem))
        problem, nx = self.simulator.problem, self.problem.system.nx  # a bad dt or constant is refused here
        limit = problem.time_limit if self.time_limit is None else float(self.time_limit)
        if not (math.isfinite(limit) and limit > 0):
            raise ValueError(f"{problem.id}: time_limit must be a positive number of seconds, got {self.time_limit}")
        object.__setattr__(self, "time_limit", limit)
        for name in ("disturbance", "observation_noise"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape not in ((), (nx,)) or not np.isfinite(values).all() or (values < 0).any():
                raise ValueError(
                    f"{problem.id}: {name} must be standard deviations ≥ 0, one number or {nx} "
                    f"({', '.join(problem.system.state.names)}), got {getattr(self, name)!r}"
                )
            object.__setattr__(self, name, frozen_array(np.broadcast_to(values, (nx,))))
        if self.delay != int(self.delay) or self.delay < 0:
            raise ValueError(f"{problem.id}: delay must be a whole number of ticks ≥ 0, got {self.delay!r}")
        if self.render_mode is not None and self.render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode must be None or one of {RENDER_MODES}, got {self.render_mode!r}")
        if self.render_mode is not None and problem.picture is None:
            raise ValueError(f"{problem.id} has no picture, so it cannot be rendered; leave render_mode at None")

    def __reduce__(self) -> tuple[Any, ...]:
        # A problem of the catalogue travels by its name: problems hold functions, which do not pickle.
        problem: Any = self.problem
        with contextlib.suppress(UnknownProblemError):
            problem = problem.id if load(problem.id) is problem else problem
        values = (self.dt, self.terminate_at_goal, self.time_limit, dict(self.constants), self.disturbance)
        return Settings, (problem, *values, self.observation_noise, self.delay, self.render_mode)

    @cached_property
    def simulator(self) -> Simulator:
        """The plant: the problem under ``constants``, shared by equal settings."""
        return _plant(self.problem, tuple(sorted(self.constants.items())), self.dt)

    @property
    def metadata(self) -> dict[str, Any]:
        """Gymnasium's metadata, with as many frames a second as there are ticks."""
        return {"render_modes": list(RENDER_MODES), "render_fps": max(1, round(1 / self.dt))}

    @cached_property
    def ticks(self) -> int:
        """Ticks after which an episode is truncated."""
        assert self.time_limit is not None
        return int(count_steps(self.time_limit, self.dt))

    @cached_property
    def disturbed(self) -> bool:
        return bool(np.any(self.disturbance))

    @cached_property
    def noisy(self) -> bool:
        return bool(np.any(self.observation_noise))

    def charge(self, ticks_left: Any) -> Any:
        """Cost charged for leaving the box with ``ticks_left`` ticks to go: nothing the episode could do costs more."""
        return largest_cost_rate(self.problem) * self.dt * ticks_left

    @cached_property
    def observation_space(self) -> gym.spaces.Box:
        """State box and context box; float32 rounds up to half a step, so the bounds lie one step further out."""
        boxes = (self.problem.system.state, self.problem.context)
        lower = np.concatenate([box.lower for box in boxes]).astype(np.float32)
        upper = np.concatenate([box.upper for box in boxes]).astype(np.float32)
        infinity = np.float32(np.inf)
        return gym.spaces.Box(np.nextafter(lower, -infinity), np.nextafter(upper, infinity), dtype=np.float32)

    @cached_property
    def action_space(self) -> gym.spaces.Box:
        box = self.problem.system.control
        return gym.spaces.Box(box.lower.astype(np.float32), box.upper.astype(np.float32), dtype=np.float32)

    def draw_parameters(self, generator: np.random.Generator) -> Array:
        """One parameter from the distribution of the problem, (np,).

        Raises:
            TableError: there is no table.
        """
        return self.problem.distribution.draw(self.problem, generator)

    def check_options(self, options: Mapping[str, Any] | None, *more: str) -> Mapping[str, Any]:
        """``options`` of a reset, which knows ``parameters``, ``extrapolate`` and ``more``, and refuses the rest."""
        known = ("parameters", "extrapolate", *more)
        for name in options or {}:
            if name not in known:
                hint = did_you_mean(name, known)
                raise ValueError(
                    f"{self.problem.id}: unknown option {name!r} of reset(); {hint}known are {list(known)}"
                )
        return options or {}

    def check_start(self, parameters: ArrayLike, options: Mapping[str, Any]) -> Array:
        """Parameters (B, np) of ``options`` whose start states lie in the operating box."""
        p = self.problem.check_parameters(parameters, extrapolate=bool(options.get("extrapolate", False)))
        states, _ = self.problem.start(p)
        outside = ~self.problem.system.state.contains(states, 1e-6)
        if outside.any():
            row = int(np.flatnonzero(outside)[0])
            raise ValueError(
                f"{self.problem.id}: parameters {p[row]} (row {row}) start outside the operating box "
                f"{self.problem.system.state.lower} … {self.problem.system.state.upper}, where no episode can begin"
            )
        return p
