"""Parameters: drawn at random, or on a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Array


def sample(problem: OptimalControlProblem, seed: int, n: int) -> Array:
    """``n`` parameters uniform in the box, (n, np); the i-th depends on the seed and on i alone.

    Raises:
        ValueError: a negative seed or number.
    """
    if n < 0 or seed < 0:
        raise ValueError(f"expected seed ≥ 0 and n ≥ 0, got {seed} and {n}")
    box = problem.parameters
    # Philox is counter-based: the rows of a longer draw begin with those of a shorter one.
    draws = np.random.Generator(np.random.Philox(key=seed)).random((n, len(box)))
    return box.lower + draws * (box.upper - box.lower)


def grid(problem: OptimalControlProblem, shape: Sequence[int]) -> Array:
    """The uniform grid over the box with both ends, (prod(shape), np); the last coordinate varies fastest.

    Args:
        problem: the problem.
        shape: points along each coordinate of p, at least 2 each.

    Raises:
        ValueError: another number of coordinates, or fewer than 2 points along one.
    """
    box = problem.parameters
    if len(shape) != len(box) or min(shape) < 2:
        raise ValueError(f"{problem.id}: expected {len(box)} numbers of points ≥ 2, got {tuple(shape)}")
    axes = [np.linspace(low, high, count) for low, high, count in zip(box.lower, box.upper, shape)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(box))
