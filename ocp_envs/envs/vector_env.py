"""Many episodes of a problem as one batched Gymnasium environment, in one process and without a loop over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ocp_envs.envs.options import RENDER_MODES, Settings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.film import Film
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.trajectory import Trajectory


class VectorEnv(gym.vector.VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """``num_envs`` episodes of :class:`~ocp_envs.envs.env.Env` as batched arrays.

    Spaces, reward, starts, ends and arguments are those of :class:`~ocp_envs.envs.env.Env`. ``info`` follows
    Gymnasium's vector convention: arrays of length ``num_envs`` and a mask ``_key`` of the rows that have the key.
    ``options["parameters"]`` is (np,) for all rows or (num_envs, np); ``options["reset_mask"]``, (num_envs,) bool,
    restarts only these rows.

    Args:
        problem: the problem or its name; given by ``gym.make_vec``.
        num_envs: number of episodes.
        autoreset_mode: what follows the end of an episode. ``NEXT_STEP``: the next step restarts it, ignoring its
            action, with reward 0. ``SAME_STEP``: it restarts at once; ``info`` has ``final_obs`` and ``final_info``.
            ``DISABLED``: the row stands still, with reward 0 and its end still flagged, until a reset restarts it.
        arguments: the keyword arguments of :class:`~ocp_envs.envs.env.Env`.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # type: ignore[misc]

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
        self.metadata = {**settings.metadata, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        self.render_mode = settings.render_mode
        self.single_observation_space = settings.observation_space
        self.single_action_space = settings.action_space
        self.observation_space = batch_space(settings.observation_space, num_envs)
        self.action_space = batch_space(settings.action_space, num_envs)
        self._run = settings.simulator.bind(num_envs, settings.disturbed)
        self._observed = np.zeros((num_envs, *settings.observation_space.shape), dtype=np.float32)
        self._parameters = np.zeros((num_envs, len(self.problem.parameters)))
        self._queue = np.zeros((num_envs, settings.delay, self.problem.system.nu))
        self._ticks = np.zeros(num_envs, dtype=np.int64)
        self._terminated = np.zeros(num_envs, dtype=np.bool_)
        self._truncated = np.zeros(num_envs, dtype=np.bool_)
        self._generators: list[np.random.Generator] = []
        self._all = np.arange(num_envs)
        self._begun = False
        self._film = Film(settings.dt, num_envs)

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

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes; see the class for ``options``.

        Args:
            seed: an integer s seeds row i with s + i; a sequence gives each row its own.
            options: ``parameters``, ``extrapolate`` and ``reset_mask``.

        Raises:
            ValueError: an unknown option, or parameters of another shape, not finite, or outside the box without
                ``extrapolate``.
        """
        known = self.settings.check_options(options, "reset_mask")
        rows = self._rows(known)
        given = known.get("parameters")
        if given is not None:
            given = self.settings.check_start(given, known)
            if len(given) not in (1, self.num_envs):
                raise ValueError(
                    f"{self.problem.id}: expected parameters of 1 or {self.num_envs} rows, got {len(given)}"
                )
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

    def show_plan(self, plans: Trajectory) -> None:
        """Show ``plans``, one for each row, in the pictures of these episodes; call it after :meth:`reset`.

        Raises:
            ValueError: another number of plans.
        """
        self._film.announce(self._all, plans)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame (height, width, 3) per row in mode ``"rgb_array"``; a window with row 0 in mode ``"human"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" or "human" when the environment is made')
            return None
        contexts = self._run.inputs[2]
        if self.render_mode == "human":
            self._film.show(self.problem, 0, contexts[0])
            return None
        return tuple(self._film.frame(self.problem, row, contexts[row]) for row in range(self.num_envs))

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
        info["failure"] = np.full(len(mask), None, dtype=object)
        info["failure"][failed] = "left_box"
        info["_failure"] = failed
    return info
