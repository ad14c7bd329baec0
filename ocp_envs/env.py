"""Gymnasium environments of a problem: thin shells on :meth:`ocp_envs.simulation.Simulator.advance`.

:class:`Env` runs one episode, :class:`VectorEnv` any number of them as batched arrays; row i of a vector environment that
was reset with ``seed=s`` is the single environment reset with ``seed=s + i``, draw by draw.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import UnknownProblemError, load
from ocp_envs.rendering import Film
from ocp_envs.simulation import Simulator, largest_cost_rate
from ocp_envs.system import Array, frozen_array

Bools = NDArray[np.bool_]
RENDER_MODES = ("rgb_array", "human")


@dataclass(frozen=True, eq=False)
class Settings:
    """What both environments are built from: the problem and the arguments of :class:`Env`."""

    problem: OptimalControlProblem
    dt: float = 0.02
    terminate_at_goal: bool = True
    time_limit: float | None = None
    constants: Mapping[str, float] = field(default_factory=dict)
    disturbance: ArrayLike = 0.0
    observation_noise: ArrayLike = 0.0
    delay: int = 0
    render_mode: str | None = None

    def __post_init__(self) -> None:
        if isinstance(self.problem, str):
            object.__setattr__(self, "problem", load(self.problem))
        problem, nx = self.problem, self.problem.system.nx
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
        try:
            problem = problem.id if load(problem.id) is problem else problem
        except UnknownProblemError:
            pass
        values = (self.dt, self.terminate_at_goal, self.time_limit, dict(self.constants), self.disturbance)
        return Settings, (problem, *values, self.observation_noise, self.delay, self.render_mode)

    @cached_property
    def simulator(self) -> Simulator:
        return Simulator(self.problem.with_constants(**self.constants), self.dt)

    @cached_property
    def ticks(self) -> int:
        """Ticks after which an episode is truncated."""
        assert self.time_limit is not None
        return math.ceil(self.time_limit / self.dt - 1e-9)

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
        """One parameter, uniform in the box, (np,)."""
        box = self.problem.parameters
        return box.lower + generator.random(len(box)) * (box.upper - box.lower)

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


class Env(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """An optimal control problem as a Gymnasium environment.

    ## Description

    The system of an :class:`~ocp_envs.problem.OptimalControlProblem` is driven from the start state of a parameter p to a
    goal ball at the lowest cost ∫L dt. Time passes in ticks of ``dt`` seconds, the control is held within a tick.
    ``ocp_envs.describe(problem)`` writes the tables below for one problem.

    ## Action Space

    ``Box(nu,)`` float32: the control in its physical units, clipped to its bounds.

    ## Observation Space

    ``Box(nx + nc,)`` float32: the state and the context (the part of p that is not a start state) within their operating
    boxes. Angles are unwrapped. ``state``, ``context`` and ``parameters`` hold the same in float64 and without noise.

    ## Reward

    Minus the cost of the tick, ∫L dt. Leaving the operating box is charged the largest cost rate over the boxes times
    the time that was left, so that failing early never pays.

    ## Starting State

    The start state of ``options["parameters"]``, (np,), if given to :meth:`reset`, else of a p uniform in the parameter
    box. ``options["extrapolate"] = True`` accepts a p outside the box.

    ## Episode End

    Terminated: the state is in the goal ball at the end of a tick (unless ``terminate_at_goal=False``), or it left the
    operating box (``info["failure"] == "left_box"``). Truncated: ``time_limit`` seconds have passed.

    ``info`` of a step: ``is_success`` (in the goal ball), ``cost`` (of the tick) and, where there is a path constraint,
    ``violation`` (how far it is violated at the end of the tick). ``info`` of a reset: ``parameters``.

    ## Arguments

    Args:
        problem: the problem or its name; given by ``gym.make``.
        dt: length of a tick in seconds.
        terminate_at_goal: whether the episode ends in the goal ball.
        time_limit: seconds until truncation; the problem's own by default.
        constants: other values of physical constants, for a plant that differs from the model.
        disturbance: standard deviation of a normal term added to ẋ, drawn for each tick; a number or (nx,).
        observation_noise: standard deviation of the normal noise on the observed state; a number or (nx,).
        delay: ticks by which the control acts late; until then the control that holds the goal acts.
        render_mode: ``None``, ``"rgb_array"`` or ``"human"``.

    ## Version History

    * v0: initial version.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": 50}

    def __init__(self, problem: OptimalControlProblem | str, **arguments: Any) -> None:
        self.settings = settings = Settings(problem, **arguments)  # type: ignore[arg-type]
        self.metadata = {**type(self).metadata, "render_fps": round(1 / settings.dt)}  # type: ignore[misc]
        self.render_mode = settings.render_mode
        self.observation_space = settings.observation_space
        self.action_space = settings.action_space
        self._run = settings.simulator.bind(1, settings.disturbed)
        self._observed = np.zeros(self.observation_space.shape, dtype=np.float32)
        self._tick = settings.ticks
        self._over = True
        self._queue: list[Array] = []
        self._parameters = np.zeros(len(self.problem.parameters))
        self._film = Film(self.problem, settings.dt, 1)

    @property
    def problem(self) -> OptimalControlProblem:
        """The nominal problem; the plant differs from it if ``constants`` were given."""
        return self.settings.problem

    @property
    def dt(self) -> float:
        """Length of a tick in seconds."""
        return self.settings.dt

    @property
    def state(self) -> Array:
        """The true state, (nx,)."""
        return self._run.inputs[0][0].copy()

    @property
    def context(self) -> Array:
        """The context of the episode, (nc,)."""
        return self._run.inputs[2][0].copy()

    @property
    def parameters(self) -> Array:
        """p of the episode, (np,)."""
        return self._parameters.copy()

    def _observation(self) -> NDArray[np.float32]:
        nx = self._run.inputs[0].shape[1]
        state = self._run.inputs[0][0]
        if self.settings.noisy:
            noise = self.settings.observation_noise * self.np_random.standard_normal(nx)
            box = self.problem.system.state
            state = np.clip(state + noise, box.lower, box.upper)
        self._observed[:nx] = state
        return self._observed.copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see the class for ``options``.

        Raises:
            ValueError: parameters of another shape, not finite, or outside the box without ``extrapolate``.
        """
        super().reset(seed=seed)
        options = options or {}
        given = options.get("parameters")
        p = self.settings.draw_parameters(self.np_random)[None] if given is None else self.settings.check_start(given, options)
        if len(p) != 1:
            raise ValueError(f"{self.problem.id}: expected the parameters of one episode, got {len(p)} rows")
        states, contexts = self.problem.start(p)
        self._run.inputs[0][:] = states
        self._run.inputs[2][:] = contexts
        self._observed[states.shape[1] :] = contexts[0]
        self._parameters = p[0]
        self._queue = [self.problem.goal.control] * self.settings.delay
        self._tick = 0
        self._over = False
        if self.render_mode is not None:
            self._film.begin(np.array([0]), states)
            if self.render_mode == "human":
                self.render()
        return self._observation(), {"parameters": self.parameters}

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One tick of ``dt`` seconds under ``action``, (nu,).

        Raises:
            ResetNeeded: the episode is over or has not begun.
        """
        if self._over:
            raise ResetNeeded(
                "the episode is over or has not begun: call reset(); to go on beyond the goal, make the environment "
                "with terminate_at_goal=False"
            )
        settings, run = self.settings, self._run
        if settings.delay:
            self._queue.append(np.array(action, dtype=np.float64))
            action = self._queue.pop(0)
        run.inputs[1][0] = action
        if settings.disturbed:
            run.inputs[3][0] = settings.disturbance * self.np_random.standard_normal(len(settings.disturbance))  # type: ignore[arg-type]
        run()
        run.inputs[0][:] = run.outputs[0]
        cost, violation, reached, left_box = run.outputs[1][0].tolist()
        info: dict[str, Any] = {"is_success": reached > 0}
        if left_box:
            cost = settings.charge(settings.ticks - self._tick)
            info["failure"] = "left_box"
        info["cost"] = cost
        if self.problem.n_clearances:
            info["violation"] = violation
        self._tick += 1
        terminated = left_box > 0 or (reached > 0 and settings.terminate_at_goal)
        truncated = not terminated and self._tick >= settings.ticks
        self._over = terminated or truncated
        if self.render_mode is not None:
            self._film.record(np.array([0]), run.inputs[0], np.array([cost]))
            if self.render_mode == "human":
                self.render()
        return self._observation(), -cost, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """The frame (height, width, 3) in mode ``"rgb_array"``; a window in mode ``"human"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" or "human" when the environment is made')
            return None
        context = self._run.inputs[2][0]
        if self.render_mode == "human":
            self._film.show(0, context)
            return None
        return self._film.frame(0, context)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._film.close()


class VectorEnv(gym.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """``num_envs`` episodes of :class:`Env` as batched arrays, in one process and without a loop over them.

    Spaces, reward, starts, ends and arguments are those of :class:`Env`. ``info`` follows Gymnasium's vector convention:
    arrays of length ``num_envs`` and a mask ``_key`` of the rows that have the key. ``options["parameters"]`` is (np,) for
    all rows or (num_envs, np); ``options["reset_mask"]``, (num_envs,) bool, restarts only these rows.

    Args:
        problem: the problem or its name; given by ``gym.make_vec``.
        num_envs: number of episodes.
        autoreset_mode: what follows the end of an episode. ``NEXT_STEP``: the next step restarts it, ignoring its action,
            with reward 0. ``SAME_STEP``: it restarts at once; ``info`` has ``final_obs`` and ``final_info``.
            ``DISABLED``: the row stands still, with reward 0 and its end still flagged, until a reset restarts it.
        arguments: the keyword arguments of :class:`Env`.
    """

    metadata: ClassVar[dict[str, Any]] = Env.metadata  # type: ignore[misc]

    def __init__(
        self,
        problem: OptimalControlProblem | str,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> None:
        self.settings = settings = Settings(problem, **arguments)  # type: ignore[arg-type]
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        fps = {"render_fps": round(1 / settings.dt)}
        self.metadata = {**Env.metadata, **fps, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        self.render_mode = settings.render_mode
        self.single_observation_space = settings.observation_space
        self.single_action_space = settings.action_space
        self.observation_space = batch_space(settings.observation_space, num_envs)
        self.action_space = batch_space(settings.action_space, num_envs)
        self._run = settings.simulator.bind(num_envs, settings.disturbed)
        self._observed = np.zeros(self.observation_space.shape or (), dtype=np.float32)
        self._parameters = np.zeros((num_envs, len(self.problem.parameters)))
        self._queue = np.zeros((num_envs, settings.delay, self.problem.system.nu))
        self._ticks = np.zeros(num_envs, dtype=np.int64)
        self._terminated = np.zeros(num_envs, dtype=np.bool_)
        self._truncated = np.zeros(num_envs, dtype=np.bool_)
        self._generators: list[np.random.Generator] = []
        self._all = np.arange(num_envs)
        self._begun = False
        self._film = Film(self.problem, settings.dt, num_envs)

    @property
    def problem(self) -> OptimalControlProblem:
        """The nominal problem; the plant differs from it if ``constants`` were given."""
        return self.settings.problem

    @property
    def dt(self) -> float:
        """Length of a tick in seconds."""
        return self.settings.dt

    @property
    def state(self) -> Array:
        """The true states, (num_envs, nx)."""
        return self._run.inputs[0].copy()

    @property
    def context(self) -> Array:
        """The contexts of the episodes, (num_envs, nc)."""
        return self._run.inputs[2].copy()

    @property
    def parameters(self) -> Array:
        """p of the running episodes, (num_envs, np)."""
        return self._parameters.copy()

    # -- starting --------------------------------------------------------------------------------------------------

    def _generator(self, row: int) -> np.random.Generator:
        if not self._generators:
            seeds = self.np_random.integers(2**31, size=self.num_envs)
            self._generators = [seeding.np_random(int(seed))[0] for seed in seeds]
        return self._generators[row]

    def _seed(self, seed: int | Sequence[int | None] | None, rows: NDArray[np.int64]) -> None:
        if seed is None:
            return
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
            seed = [int(seed) + row for row in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"expected an integer seed or {self.num_envs} seeds, got {len(seed)}")
        if len(self._generators) < self.num_envs and None not in seed:
            self._generators = [seeding.np_random(s)[0] for s in seed]
            return
        for row in rows:
            if seed[row] is not None:
                self._generator(row)
                self._generators[row] = seeding.np_random(seed[row])[0]

    def _start(self, rows: NDArray[np.int64], parameters: Array | None = None) -> None:
        """Start new episodes in ``rows`` from ``parameters`` (len(rows), np), drawn if not given."""
        if parameters is None:
            parameters = np.array([self.settings.draw_parameters(self._generator(row)) for row in rows])
        states, contexts = self.problem.start(parameters)
        self._run.inputs[0][rows] = states
        self._run.inputs[2][rows] = contexts
        self._observed[rows, states.shape[1] :] = contexts
        self._parameters[rows] = parameters
        self._queue[rows] = self.problem.goal.control
        self._ticks[rows] = 0
        self._terminated[rows] = False
        self._truncated[rows] = False
        if self.render_mode is not None:
            self._film.begin(rows, states)

    def _rows(self, options: Mapping[str, Any]) -> NDArray[np.int64]:
        if "reset_mask" not in options:
            return self._all
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(
                f"options['reset_mask'] must be a boolean array ({self.num_envs},) with at least one True, "
                f"got {mask.dtype} of shape {mask.shape}"
            )
        if not self._begun and not mask.all():
            raise ResetNeeded("the first reset must start all rows; call reset() without a reset_mask")
        return np.flatnonzero(mask)

    def reset(  # type: ignore[override]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes; see the class for ``options``.

        Args:
            seed: an integer s seeds row i with s + i; a sequence gives each row its own.
            options: ``parameters``, ``extrapolate`` and ``reset_mask``.

        Raises:
            ValueError: parameters of another shape, not finite, or outside the box without ``extrapolate``.
        """
        options = options or {}
        rows = self._rows(options)
        given = options.get("parameters")
        if given is not None:
            given = self.settings.check_start(given, options)
            if len(given) not in (1, self.num_envs):
                raise ValueError(f"{self.problem.id}: expected parameters of 1 or {self.num_envs} rows, got {len(given)}")
            given = np.broadcast_to(given, self._parameters.shape)[rows]
        self._seed(seed, rows)
        self._start(rows, given)
        self._begun = True
        started = np.zeros(self.num_envs, dtype=np.bool_)
        started[rows] = True
        self._observe(rows)
        if self.render_mode == "human":
            self.render()
        return self._observed.copy(), self._start_info(started)

    def _start_info(self, started: Bools) -> dict[str, Any]:
        return {"parameters": np.where(started[:, None], self._parameters, 0.0), "_parameters": started}

    # -- running ---------------------------------------------------------------------------------------------------

    def _observe(self, rows: NDArray[np.int64]) -> None:
        """Measure the states of ``rows`` anew."""
        states = self._run.inputs[0]
        nx = states.shape[1]
        if self.settings.noisy:
            noise = np.array([self._generator(row).standard_normal(nx) for row in rows])
            box = self.problem.system.state
            measured = states[rows] + self.settings.observation_noise * noise.reshape(-1, nx)
            self._observed[rows, :nx] = np.clip(measured, box.lower, box.upper)
        elif len(rows) == self.num_envs:
            self._observed[:, :nx] = states
        else:
            self._observed[rows, :nx] = states[rows]

    def _apply(self, actions: ArrayLike, rows: NDArray[np.int64]) -> None:
        """Write controls and disturbances of ``rows`` into the simulator; those of other rows do not matter."""
        actions = np.asarray(actions)
        controls = self._run.inputs[1]
        if actions.shape != controls.shape:
            raise ValueError(f"{self.problem.id}: expected actions of shape {controls.shape}, got {actions.shape}")
        if self.settings.delay:
            controls[:] = self._queue[:, 0]
            self._queue[rows] = np.concatenate([self._queue[rows, 1:], actions[rows, None]], axis=1)
        else:
            controls[:] = actions
        if self.settings.disturbed:
            nx = self.problem.system.nx
            draws = np.array([self._generator(row).standard_normal(nx) for row in rows])
            self._run.inputs[3][rows] = self.settings.disturbance * draws.reshape(-1, nx)

    def step(self, actions: ArrayLike) -> tuple[NDArray[np.float32], Array, Bools, Bools, dict[str, Any]]:
        """One tick of ``dt`` seconds under ``actions``, (num_envs, nu); rows whose episode is over do not move.

        Raises:
            ResetNeeded: before the first :meth:`reset`.
            ValueError: actions of another shape.
        """
        if not self._begun:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        over = self._terminated | self._truncated
        moving = ~over
        rows = np.flatnonzero(moving) if over.any() else self._all
        self._apply(actions, rows)
        cost, values, left_box = self._move(moving, rows)
        self._observe(rows)
        if self.render_mode is not None:
            self._film.record(rows, self._run.inputs[0], cost)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        ended = moving & (terminated | truncated)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and len(rows) < self.num_envs:
            info = _vector_info(values, moving, left_box) | self._restart(over)
            terminated[over] = truncated[over] = False
        elif self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(ended):
                final[row] = self._observed[row].copy()
            info = _vector_info(values, moving & ~ended, left_box)
            info |= {"final_obs": final, "_final_obs": ended}
            info |= {"final_info": _vector_info(values, ended, left_box), "_final_info": ended.copy()}
            info |= self._restart(ended)
        else:
            info = _vector_info(values, moving, left_box)
        if self.render_mode == "human":
            self.render()
        return self._observed.copy(), -cost, terminated, truncated, info

    def _move(self, moving: Bools, rows: NDArray[np.int64]) -> tuple[Array, dict[str, NDArray[Any]], Bools]:
        """Advance the moving rows; their cost, the values of ``info``, and which left the box, each (num_envs,)."""
        run, settings = self._run, self.settings
        run()
        following, summary = run.outputs
        if len(rows) == self.num_envs:
            run.inputs[0][:] = following
        else:
            run.inputs[0][rows] = following[rows]
        reached = (summary[:, 2] > 0) & moving
        left_box = (summary[:, 3] > 0) & moving
        cost = np.where(moving, summary[:, 0], 0.0)
        if left_box.any():
            cost[left_box] = settings.charge(settings.ticks - self._ticks[left_box])
        self._ticks += moving
        terminated = left_box | reached if settings.terminate_at_goal else left_box
        self._terminated |= terminated
        self._truncated |= moving & ~terminated & (self._ticks >= settings.ticks)
        values = {"is_success": reached, "cost": cost}
        if self.problem.n_clearances:
            values["violation"] = summary[:, 1].copy()
        return cost, values, left_box

    def _restart(self, mask: Bools) -> dict[str, Any]:
        """Start new episodes in the rows of ``mask``; their ``info``."""
        rows = np.flatnonzero(mask)
        self._start(rows)
        self._observe(rows)
        return self._start_info(mask)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """A frame (height, width, 3) per row in mode ``"rgb_array"``; a window with row 0 in mode ``"human"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" or "human" when the environment is made')
            return None
        contexts = self._run.inputs[2]
        if self.render_mode == "human":
            self._film.show(0, contexts[0])
            return None
        return tuple(self._film.frame(row, contexts[row]) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window, if there is one."""
        self._film.close()


def _vector_info(values: Mapping[str, NDArray[Any]], mask: Bools, left_box: Bools) -> dict[str, Any]:
    """``values`` of the rows of ``mask`` in Gymnasium's vector convention."""
    info: dict[str, Any] = {}
    if not mask.any():
        return info
    for key, value in values.items():
        info[key] = np.where(mask, value, np.zeros((), dtype=value.dtype))
        info[f"_{key}"] = mask.copy()
    failed = left_box & mask
    if failed.any():
        info["failure"] = np.where(failed, np.array("left_box", dtype=object), None)
        info["_failure"] = failed
    return info
