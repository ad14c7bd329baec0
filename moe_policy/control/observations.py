"""How policies read observations: as numbers, split into state and context."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools

#: Observations further outside the operating box than so many times its width are moved there, so that no number is so
#: large that a control computed from it is none.
_FAR = 1e6


class Observations:
    """Reads observations of ``problem``."""

    def __init__(self, problem: OptimalControlProblem) -> None:
        self._name, self._width = problem.id, problem.system.nx + len(problem.context)
        boxes = (problem.system.state, problem.context)
        self._lower, self._upper = (
            np.concatenate([box.centre + sign * _FAR * box.width for box in boxes]) for sign in (-1, 1)
        )
        # Observations whose squares add up to less are within all bounds.
        self._near = max(0.0, float(np.minimum(-self._lower, self._upper).min())) ** 2

    def __call__(self, observation: ArrayLike) -> Array:
        """An ``observation`` (B, nx + nc) or (nx + nc,) as (B, nx + nc) in float64, bounded but for NaN.

        Raises:
            ValueError: another shape, or no numbers.
        """
        values = np.asarray(observation)
        if values.dtype.kind not in "fiub":
            raise ValueError(f"{self._name}: expected observations of numbers, got {values.dtype}")
        if values.ndim not in (1, 2) or values.shape[-1] != self._width:
            raise ValueError(f"{self._name}: expected observations (B, {self._width}), got {values.shape}")
        bounded = np.array(values, dtype=np.float64, ndmin=2)
        if not np.vdot(bounded, bounded) < self._near:  # nearly never, and it takes as long as the rest
            np.maximum(bounded, self._lower, out=bounded)
            np.minimum(bounded, self._upper, out=bounded)
        return bounded


def split(problem: OptimalControlProblem, observations: ArrayLike) -> tuple[Array, Array]:
    """States (B, nx) and contexts (B, nc) of ``observations`` (B, nx + nc) of ``problem``."""
    values, nx = np.asarray(observations, dtype=np.float64), problem.system.nx
    return values[:, :nx], values[:, nx:]


def beginning(episode_start: ArrayLike | None, size: int) -> Bools:
    """Mask (``size``,) of the rows in which an episode begins; none does where ``episode_start`` is ``None``."""
    flags = np.zeros(size, bool) if episode_start is None else np.asarray(episode_start, bool)
    if flags.shape not in ((), (1,), (size,)):
        raise ValueError(f"expected episode_start ({size},), got {flags.shape}")
    return flags if flags.shape == (size,) else np.broadcast_to(flags, size)
