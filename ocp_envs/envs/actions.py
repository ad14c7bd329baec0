"""The actions given to an environment, as controls."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools


def controls_of(problem: OptimalControlProblem, actions: ArrayLike, shape: tuple[int, ...]) -> Array:
    """``actions`` of an environment of ``problem`` as controls of ``shape`` in float64; they may hold NaN.

    Raises:
        ValueError: actions of another shape, or that are no numbers.
    """
    try:
        given = np.asarray(actions)
    except ValueError as error:
        raise ValueError(f"{problem.id}: expected an array of numbers {shape} as action, got a ragged list") from error
    if given.dtype.kind not in "fiub":
        raise ValueError(f"{problem.id}: expected numbers as action, got {actions!r} ({given.dtype})")
    if given.shape != shape:
        raise ValueError(f"{problem.id}: expected an action of shape {shape}, got {given.shape}")
    return given.astype(np.float64)


def nan_rows(controls: Array) -> Bools:
    """Which rows of ``controls`` (B, nu) hold a NaN, (B,)."""
    return np.asarray(np.isnan(controls).any(axis=1))
