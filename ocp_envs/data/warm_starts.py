"""Warm starts of an instance from the solutions of its nearest neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ocp_envs.data.database import Database
from ocp_envs.data.neighbours import Neighbours
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.support.arrays import Array, Bools, Ints

Floats = NDArray[np.float32]
#: Of the local fit: ridge on its slopes, and weight of the farthest neighbours relative to 1 of the nearest.
_RIDGE = 1e-3
_MINIMUM_WEIGHT = 1e-3


class _Family(NamedTuple):
    """The solutions of one solution family: their parameters and their flat trajectories, (K, flat_size)."""

    parameters: Neighbours
    z: Floats


class Library:
    """The solutions of finished rounds, the first ``count`` rows of ``database``, by nearest parameters."""

    def __init__(self, database: Database, count: int) -> None:
        box, parameters = database.problem.parameters, database.stored_parameters(slice(0, count))
        self._all = Neighbours(box, parameters)
        costs: list[Array] = []
        rows_of: list[list[Ints]] = [[] for _ in database.problem.modes.names]
        z_of: list[list[Floats]] = [[] for _ in database.problem.modes.names]
        for where, stored in database.blocks(count):
            costs.append(stored.cost)
            for mode, found in enumerate(np.isfinite(stored.cost).T):
                rows_of[mode].append(np.flatnonzero(found) + where.start)
                z_of[mode].append(stored.z[found, mode].astype(np.float32))
        self._cost = np.concatenate(costs)
        self._families: dict[int, _Family] = {}
        for mode, rows in enumerate(map(np.concatenate, rows_of)):
            z, z_of[mode] = np.concatenate(z_of[mode]), []  # frees the pieces
            if len(rows):
                self._families[mode] = _Family(Neighbours(box, parameters[rows]), z)

    def warm_starts(self, parameters: Array, settings: GenerationSettings) -> tuple[Ints, Floats]:
        """The W warm starts of the B instances with ``parameters`` (B, np), as ``settings`` say.

        Returns:
            which instance each belongs to, (W,), ascending, and the warm starts in the flat layout, (W, flat_size).
        """
        wanted = self._wanted(parameters, settings)
        owner, guess = [np.empty(0, np.int64)], []
        for mode, family in self._families.items():
            rows = np.flatnonzero(wanted[:, mode])
            found = _fitted(family, parameters[rows], settings.fit)
            if found is None:
                found = _nearest(family, parameters[rows], settings.neighbours)
            owner.append(np.repeat(rows, len(found) // max(len(rows), 1)))
            guess.append(found)
        if not guess:
            return owner[0], np.empty((0, 0), np.float32)
        every = np.concatenate(owner)
        order = np.argsort(every, kind="stable")
        return every[order], np.concatenate(guess)[order]

    def _wanted(self, parameters: Array, settings: GenerationSettings) -> Bools:
        """Which families have the lowest or nearly the lowest cost at a neighbour, (B, modes)."""
        cost = self._cost[self._all.nearest(parameters, settings.lookaround)[1]]
        with np.errstate(invalid="ignore"):
            best = cost.min(axis=2, keepdims=True)
            near = cost <= best + settings.margin * np.abs(best)
        return (near & np.isfinite(cost)).any(axis=1)


def _nearest(family: _Family, parameters: Array, count: int) -> Floats:
    """The trajectories of the ``count`` nearest solutions of each of B instances, (B · count, flat_size)."""
    return family.z[family.parameters.nearest(parameters, count)[1].ravel()]


def _fitted(family: _Family, parameters: Array, count: int) -> Floats | None:
    """A fit through the ``count`` nearest solutions of each of B instances; ``None`` where these are too few."""
    if min(count, len(family.z)) <= parameters.shape[1]:
        return None
    distance, nearest = family.parameters.nearest(parameters, count)
    return local_fit(family.parameters.offsets(parameters, nearest), distance, family.z[nearest])


def local_fit(offsets: Array, distance: Array, values: Floats) -> Floats:
    """Value at offset 0 of a linear function fitted to the ``values`` (B, K, m) of K neighbours, (B, m).

    Their parameters have ``offsets`` (B, K, np) with lengths ``distance`` (B, K), ascending. Least squares with the
    weights 1 − (d / d_K)² of Epanechnikov's kernel and a small ridge on the slopes, which counts where the neighbours
    do not span all directions (Cleveland & Devlin, *Locally weighted regression*, 1988).
    """
    reach = np.maximum(distance[:, -1:], np.finfo(float).tiny)
    weights = np.maximum(1 - (distance / reach) ** 2, _MINIMUM_WEIGHT)
    design = np.concatenate([np.ones((*distance.shape, 1)), offsets / reach[:, :, None]], axis=2)
    weighted = np.swapaxes(design * weights[:, :, None], 1, 2)
    normal = weighted @ design + _RIDGE * np.diag([0.0, *np.ones(offsets.shape[2])])
    # The fitted constant is linear in the values: its coefficients are the first row of (DᵀWD)⁻¹ DᵀW.
    first = np.linalg.solve(normal, np.broadcast_to(np.eye(normal.shape[1])[:, :1], (*normal.shape[:2], 1)))
    coefficients = (np.swapaxes(first, 1, 2) @ weighted).astype(np.float32)
    return (coefficients @ values)[:, 0]
