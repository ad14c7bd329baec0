"""Whether an environment, of whatever library and in whatever wrappers, is one for which a policy is made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np

from ocp_envs.envs.interface import Interface

#: An environment or vector environment of Gymnasium, or a ``VecEnv`` of Stable-Baselines3, which may be absent.
Environment: TypeAlias = Any


def check_environment(expected: Interface, env: Environment) -> None:
    """Refuse an environment ``env`` that does not have the ``expected`` interface, as ``ModelPolicy.check`` documents.

    Raises:
        TypeError: another environment than one of :mod:`ocp_envs`.
        ValueError: another interface.
    """
    for found in _interfaces(env):
        _check_interface(expected, found)
    inner = _interfaces(env)[0]
    single = isinstance(env, gym.vector.VectorEnv)
    _check_space(inner, env.single_observation_space if single else env.observation_space, "observation")
    _check_space(inner, env.single_action_space if single else env.action_space, "action")
    layer = env
    while layer is not None:  # Stable-Baselines3 leaves the space as it is
        if getattr(layer, "norm_obs", False) is True:
            raise ValueError(
                f"{expected.problem}: expected observations in their units, got those of {type(layer).__name__}; "
                "run the policy in the environment inside that wrapper, or with norm_obs=False"
            )
        layer = vars(layer).get("venv")


def _interfaces(env: Environment) -> Sequence[Interface]:
    """The interfaces of the environments of :mod:`ocp_envs` inside the wrappers of ``env``, at least one."""
    found: Any = ()
    try:
        if isinstance(env, (gym.Env, gym.vector.VectorEnv)) and hasattr(env.unwrapped, "interface"):
            found = [env.unwrapped.interface]
        elif isinstance(env, gym.vector.VectorEnv):
            found = env.unwrapped.get_attr("interface")  # type: ignore[attr-defined]
        elif hasattr(env, "env_method"):
            found = env.get_attr("interface")
    except AttributeError:
        pass
    if not found or not all(isinstance(each, Interface) for each in found):
        kind = type(getattr(env, "unwrapped", env)).__name__
        raise TypeError(f"expected an environment of ocp_envs, single or vector, wrapped or not; got {kind}")
    return list(found)


def _check_interface(expected: Interface, found: Interface) -> None:
    if not math.isclose(expected.dt, found.dt, rel_tol=1e-9):
        raise ValueError(
            f"{expected.problem}: got a policy for {expected.dt} s in environments of {found.dt} s, expected the same "
            f"dt; make the environments or the policy with dt={found.dt} or dt={expected.dt}"
        )
    boxes = ((getattr(expected, name), getattr(found, name)) for name in ("state", "context", "control"))
    signatures = ([[(c.name, c.unit, c.period) for c in box.coordinates] for box in pair] for pair in boxes)
    if any(mine != theirs for mine, theirs in signatures):
        raise ValueError(
            f"{expected.problem}: expected an environment with {expected.coordinates}; got {found.problem} with "
            f"{found.coordinates}: make a policy for that problem"
        )


def _check_space(found: Interface, space: gym.Space[Any], kind: str) -> None:
    """Refuse a ``space`` of a wrapped environment that is another one than that of the environment ``found`` in it."""
    inner: gym.spaces.Box = getattr(found, f"{kind}_space")
    if isinstance(space, gym.spaces.Box) and space.shape == inner.shape:
        same = np.allclose(space.low, inner.low, rtol=1e-6) and np.allclose(space.high, inner.high, rtol=1e-6)
        clipped = kind == "action" and np.isneginf(space.low).all() and np.isposinf(space.high).all()
        if same or clipped:
            return
    raise ValueError(
        f"{found.problem}: a wrapper changes the {kind}s, which this policy takes as they are: expected {inner}, got "
        f"{space}; run it in the environment without that wrapper, or make it part of the policy"
    )
