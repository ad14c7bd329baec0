"""What Gymnasium notes of an environment that it makes, completed by what the environment knows."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from enum import Enum
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from ocp_envs.envs.options import EnvOptions


def completed(spec: EnvSpec | None, options: EnvOptions) -> EnvSpec | None:
    """A copy of the ``spec`` of an environment with ``options``, with its time limit and arguments that JSON can hold.

    ``max_episode_steps`` is the number of control steps to the time limit. It cannot be registered, because it depends
    on ``dt`` and ``time_limit``.
    """
    if spec is None:
        return None
    limits = [options.max_steps, *([] if spec.max_episode_steps is None else [spec.max_episode_steps])]
    spec = copy.copy(spec)
    spec.max_episode_steps = min(limits)
    spec.kwargs = {name: _plain(value) for name, value in spec.kwargs.items()}
    return spec


def _plain(value: Any) -> Any:
    """Arrays and NumPy's scalars as Python's numbers and lists, mappings as dictionaries; anything else as it is."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return value.value if isinstance(value, Enum) else value
