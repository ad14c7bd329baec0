"""Parameters to solve for: random draws that depend on (seed, index) alone, and grids."""

from __future__ import annotations

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Array

#: Numbers that Philox makes for one value of its counter.
_BLOCK = 4


def sample(problem: OptimalControlProblem, seed: int, n: int, offset: int = 0) -> Array:
    """Samples ``offset`` … ``offset + n − 1`` of the uniform distribution on the parameter box, (n, np).

    The i-th sample depends on (seed, i) alone: every sample owns whole blocks of the counter-based generator Philox
    (Salmon et al., *Parallel random numbers: as easy as 1, 2, 3*, 2011).

    Raises:
        ValueError: a negative seed, n or offset.
    """
    if seed < 0 or n < 0 or offset < 0:
        raise ValueError(f"seed, n and offset must not be negative, got {seed}, {n}, {offset}")
    box = problem.parameters
    blocks = -(-len(box) // _BLOCK)
    bits = np.random.Philox(key=seed)
    bits.advance(offset * blocks)
    uniform = np.random.Generator(bits).random((n, blocks * _BLOCK))[:, : len(box)]
    return np.asarray(box.lower + uniform * (box.upper - box.lower))


def grid(problem: OptimalControlProblem, shape: tuple[int, ...]) -> Array:
    """The uniform grid on the parameter box with both ends, (∏ shape, np); the last coordinate runs fastest.

    Raises:
        ValueError: not one number ≥ 2 for every coordinate.
    """
    box = problem.parameters
    if len(shape) != len(box) or min(shape) < 2:
        raise ValueError(
            f"{problem.id}: expected {len(box)} numbers ≥ 2, one for each of {', '.join(box.names)}; got {shape}"
        )
    axes = [np.linspace(c.lower, c.upper, size) for c, size in zip(box.coordinates, shape)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(box))
