"""How policies split an observation into state and context, and shape their controls to match it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools


def split(problem: OptimalControlProblem, observation: ArrayLike) -> tuple[Array, Array]:
    """States (B, nx) and contexts (B, nc) of an ``observation`` (B, nx + nc) or (nx + nc,) of ``problem``."""
    values = np.atleast_2d(np.asarray(observation, dtype=np.float64))
    nx, nc = problem.system.nx, len(problem.context)
    if values.ndim != 2 or values.shape[1] != nx + nc:
        raise ValueError(f"{problem.id}: expected observations (B, {nx + nc}), got {np.shape(observation)}")
    return values[:, :nx], values[:, nx:]


def beginning(episode_start: ArrayLike | None, size: int) -> Bools:
    """Mask (``size``,) of the rows in which an episode begins; none does where ``episode_start`` is ``None``."""
    return np.zeros(size, bool) if episode_start is None else np.broadcast_to(np.asarray(episode_start, bool), size)


def shaped_as(observation: ArrayLike, controls: Array) -> Array:
    """``controls`` (B, nu), or (nu,) for a single ``observation`` (nx + nc,)."""
    return controls[0] if np.ndim(observation) == 1 else controls
