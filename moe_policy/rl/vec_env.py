"""Vector environments of Gymnasium as a ``VecEnv`` of Stable-Baselines3."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from moe_policy.rl.features import Float32
from moe_policy.rl.wrappers import Info


class SB3VecEnv(VecEnv):
    """A Gymnasium vector environment with Stable-Baselines3's interface; all rows are one batch.

    A row whose episode ended restarts in the same step: its observation is the first of the new episode, and ``info``
    has ``terminal_observation`` and, as in every step, ``TimeLimit.truncated``. ``seed(s)`` seeds row i with s + i at
    the next reset. Rows share one environment, so attributes can be read for some rows but are set for all. ``envs``,
    wrapped or not, is made with ``autoreset_mode="Disabled"``, so that an episode's last observation is seen.
    """

    def __init__(self, envs: gym.vector.VectorEnv[Float32, Float32, Any]) -> None:
        mode = envs.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.DISABLED:
            raise ValueError(f'SB3VecEnv needs an environment made with autoreset_mode="Disabled", got {mode}')
        self.envs = envs
        self._actions: NDArray[Any] = np.zeros(0)
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = dict(envs.metadata)

    def _joined_options(self) -> Info:
        """The options given for the rows, joined: parameters are stacked, anything else must agree."""
        given = self._options
        if not any(given):
            return {}
        if any(set(options) != set(given[0]) for options in given):
            raise ValueError("set_options: every row must be given the same keys")
        joined = dict(given[0])
        if "parameters" in joined:
            joined["parameters"] = np.stack([options["parameters"] for options in given])
        return joined

    def reset(self) -> NDArray[np.float32]:
        """Start an episode in every row; first observations (num_envs, n). Seeds and options are used once."""
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        observations, info = self.envs.reset(seed=seeds, options=self._joined_options())  # type: ignore[arg-type]
        self.reset_infos = self._row_infos(info)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[Info]]:
        """Observations (num_envs, n), rewards, dones and infos of one step; ended rows have restarted."""
        observations, rewards, terminated, truncated, info = self.envs.step(self._actions)
        infos = self._row_infos(info)
        for row_info, cut in zip(infos, truncated & ~terminated):
            row_info["TimeLimit.truncated"] = bool(cut)
        dones = terminated | truncated
        if dones.any():
            for row in np.flatnonzero(dones):
                infos[row]["terminal_observation"] = observations[row].copy()
            observations, info = self.envs.reset(options={"reset_mask": dones})
            started = self._row_infos(info)
            for row in np.flatnonzero(dones):
                self.reset_infos[row] = started[row]
        return observations, np.asarray(rewards, dtype=np.float32), dones, infos

    def _row_infos(self, info: Info) -> list[Info]:
        """Gymnasium's dictionary of arrays and masks as one dictionary a row."""
        infos: list[Info] = [{} for _ in range(self.num_envs)]
        for key, values in info.items():
            for row in np.flatnonzero(info.get(f"_{key}", ())):
                infos[row][key] = values[row]
        return infos

    def close(self) -> None:
        self.envs.close()

    def get_images(self) -> list[NDArray[np.uint8] | None]:
        frames = self.envs.render()
        return [None] * self.num_envs if frames is None else list(frames)  # type: ignore[arg-type]

    def _owner(self, name: str) -> Any:
        """The outermost of the wrappers and the environment that has the attribute ``name``."""
        layer: Any = self.envs
        while not hasattr(layer, name):
            if layer is layer.unwrapped:
                raise AttributeError(f"the environment has no attribute {name!r}")
            layer = layer.env
        return layer

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute ``attr_name`` for each of ``indices``: of an array with a row for each, that row."""
        value = getattr(self._owner(attr_name), attr_name)
        rows = self._get_indices(indices)
        if isinstance(value, np.ndarray) and value.shape[:1] == (self.num_envs,):
            return [value[row] for row in rows]
        return [value for _ in rows]

    def _all_rows(self, what: str, indices: VecEnvIndices) -> None:
        if len(set(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{what}: the rows are one batched environment; leave indices at None")

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        self._all_rows("set_attr", indices)
        setattr(self.envs.unwrapped, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        self._all_rows("env_method", indices)
        result = getattr(self._owner(method_name), method_name)(*method_args, **method_kwargs)
        return [result for _ in range(self.num_envs)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """Whether a vector wrapper of ``wrapper_class`` is around the environment, for each of ``indices``."""
        layer: Any = self.envs
        while not isinstance(layer, wrapper_class) and layer is not layer.unwrapped:
            layer = layer.env
        return [isinstance(layer, wrapper_class) for _ in self._get_indices(indices)]
