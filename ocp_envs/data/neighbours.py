"""The nearest of many parameters, every coordinate of p divided by the width of its box."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ocp_envs.support.arrays import Array, Ints
from ocp_envs.system import Box

_FARTHEST = 1e100


class Neighbours:
    """A search among stored ``parameters`` (M, np), in or near ``box``."""

    def __init__(self, box: Box, parameters: Array) -> None:
        self._width = box.width
        self._tree = cKDTree(self._scaled(parameters))

    def _scaled(self, p: Array) -> Array:
        """``p`` in box widths, at most so far away that squares of distances are finite."""
        return np.clip(p / self._width, -_FARTHEST, _FARTHEST)

    def nearest(self, p: Array, k: int) -> tuple[Array, Ints]:
        """Distances in box widths and rows of the ``k`` ≥ 1 stored parameters nearest to ``p`` (B, np), both (B, k).

        The nearest come first; where fewer are stored, these are all of them.
        """
        distance, rows = self._tree.query(self._scaled(p), k=range(1, min(k, self._tree.n) + 1))
        return np.asarray(distance), np.asarray(rows, dtype=np.int64)

    def offsets(self, p: Array, rows: Ints) -> Array:
        """From parameters ``p`` (B, np) to the stored ones at ``rows`` (B, k), in box widths, (B, k, np)."""
        return np.asarray(self._tree.data[rows] - (p / self._width)[:, None])


def neighbour_pairs(box: Box, parameters: Array, k: int) -> Ints:
    """Pairs i < j of M ≥ 1 ``parameters`` (M, np) of which one is among the ``k`` nearest of the other, (E, 2).

    Distances are those of :class:`Neighbours` in ``box``; every pair occurs once, in ascending order.
    """
    count = len(parameters)
    _, nearest = Neighbours(box, parameters).nearest(parameters, k + 1)  # the nearest is the point itself, or a copy
    own = np.repeat(np.arange(count), nearest.shape[1])
    other = nearest.ravel()
    low, high = np.minimum(own, other), np.maximum(own, other)
    numbers = np.unique((low * count + high)[low < high])
    return np.stack([numbers // count, numbers % count], axis=1)
