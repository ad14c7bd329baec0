"""Rounds: which chunks belong together, and what the earlier ones give a later one to start from."""

from __future__ import annotations

from collections.abc import Iterator

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from ocp_envs.data.database import Database
from ocp_envs.data.neighbours import Neighbours
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.data.worker import PATIENCE, Chunk
from ocp_envs.support.arrays import Array

#: Of the local fit: ridge on its slopes, and weight of the farthest neighbours beside 1 of the nearest.
_RIDGE = 1e-3
_LEAST_WEIGHT = 1e-3


class Library:
    """The solutions of finished rounds, by nearest parameters.

    Args:
        database: where they are.
        count: how many of its stored rows belong to finished rounds.
    """

    def __init__(self, database: Database, count: int) -> None:
        box, parameters = database.problem.parameters, database.stored_parameters(slice(0, count))
        self._all = Neighbours(box, parameters)
        costs: list[Array] = []
        found: dict[int, list[tuple[NDArray[np.int64], NDArray[np.float32]]]] = {}
        for where, rows in database.blocks(count):
            costs.append(rows.cost)
            for mode in range(rows.cost.shape[1]):
                have = np.flatnonzero(np.isfinite(rows.cost[:, mode]))
                if len(have):
                    found.setdefault(mode, []).append((have + where.start, rows.z[have, mode].astype(np.float32)))
        self._cost = np.concatenate(costs)
        self._by_mode: dict[int, tuple[Neighbours, NDArray[np.float32]]] = {}
        for mode in sorted(found):
            at = np.concatenate([row for row, _ in found[mode]])
            self._by_mode[mode] = (Neighbours(box, parameters[at]), np.concatenate([z for _, z in found.pop(mode)]))

    def warm_starts(
        self, parameters: Array, settings: GenerationSettings
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Row and flat guess of every warm start of ``parameters`` (B, np), ordered by row."""
        cost = self._cost[self._all.nearest(parameters, settings.lookaround)[1]]
        with np.errstate(invalid="ignore"):
            best = cost.min(axis=2, keepdims=True)
            near = cost <= best + settings.margin * np.abs(best)
        wanted = (near & np.isfinite(cost)).any(axis=1)
        owner, guess = [], []
        for mode, (stored, z) in self._by_mode.items():
            rows = np.flatnonzero(wanted[:, mode])
            distance, nearest = stored.nearest(parameters[rows], settings.fit or settings.neighbours)
            if settings.fit and nearest.shape[1] > parameters.shape[1]:
                owner.append(rows)
                guess.append(local_fit(stored.offsets(parameters[rows], nearest), distance, z[nearest]))
            else:
                nearest = nearest[:, : settings.neighbours]
                owner.append(np.repeat(rows, nearest.shape[1]))
                guess.append(z[nearest.ravel()])
        if not owner:
            return np.empty(0, np.int64), np.empty((0, 0), np.float32)
        every = np.concatenate(owner)
        order = np.argsort(every, kind="stable")
        return every[order], np.concatenate(guess)[order]


def local_fit(offsets: Array, distance: Array, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Value at offset 0 of a linear function fitted to K nearest values, (B, m).

    Least squares with the weights 1 − (d / d_K)² of Epanechnikov's kernel and a small ridge on the slopes, which counts
    where the neighbours do not span all directions (Cleveland & Devlin, *Locally weighted regression*, 1988).

    Args:
        offsets: of the neighbours' parameters, (B, K, np).
        distance: their lengths, (B, K), ascending.
        values: (B, K, m).
    """
    reach = np.maximum(distance[:, -1:], np.finfo(float).tiny)
    weights = np.maximum(1 - (distance / reach) ** 2, _LEAST_WEIGHT)
    design = np.concatenate([np.ones((*distance.shape, 1)), offsets / reach[:, :, None]], axis=2)
    weighted = np.swapaxes(design * weights[:, :, None], 1, 2)
    normal = weighted @ design + _RIDGE * np.diag([0.0, *np.ones(offsets.shape[2])])
    # The fitted constant is linear in the values: its coefficients are the first row of (DᵀWD)⁻¹ DᵀW.
    first = np.linalg.solve(normal, np.broadcast_to(np.eye(normal.shape[1])[:, :1], (*normal.shape[:2], 1)))
    coefficients = (np.swapaxes(first, 1, 2) @ weighted).astype(np.float32)
    return (coefficients @ values)[:, 0]


def rounds(database: Database, settings: GenerationSettings) -> list[range]:
    """Chunks of every round: n₀, 2n₀, 4n₀ … problems, in whole chunks."""
    size = max(1, -(-settings.first // settings.chunk))
    rounds, begin = [], 0
    while begin < database.chunks:
        rounds.append(range(begin, min(begin + size, database.chunks)))
        begin += size
        size *= 2
    return rounds


def tasks(database: Database, settings: GenerationSettings, seed: int, chunks: range) -> Iterator[Chunk]:
    """The tasks of a round that are not done yet."""
    problem = database.problem
    payload = cloudpickle.dumps(problem)
    present = database.present()
    missing = [chunk for chunk in chunks if not present[chunk]]
    library = None
    if missing and chunks.start > 0:
        library = Library(database, database.stored_rows(chunks.start).start)
    for chunk in missing:
        p = database.stored_parameters(database.stored_rows(chunk))
        if library is None:
            owner, z = np.empty(0, np.int64), np.empty((0, problem.flat_size), np.float32)
            cold = np.full(len(p), settings.starts)
        else:
            owner, z = library.warm_starts(p, settings)
            # Where no neighbour has a solution there is nothing to start from but guesses.
            warm = np.isin(np.arange(len(p)), owner)
            cold = np.where(warm, settings.cold, max(settings.cold, PATIENCE))
        yield Chunk(chunk, payload, settings, (seed, chunk), p, owner, z, cold)
