"""Rounds: which chunks are solved together, from what earlier rounds found."""

from __future__ import annotations

from collections.abc import Iterator

import cloudpickle
import numpy as np

from ocp_envs.data.database import Database
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.data.warm_starts import Library
from ocp_envs.data.worker import PATIENCE, Chunk


def first_rows(settings: GenerationSettings) -> int:
    """How many instances the first round has with ``settings``: whole chunks."""
    return max(1, -(-settings.first // settings.chunk)) * settings.chunk


def rounds(database: Database, settings: GenerationSettings) -> list[range]:
    """Chunk numbers of every round of ``database``: n₀, 2n₀, 4n₀ … instances, in whole chunks, as in ``settings``."""
    size = first_rows(settings) // settings.chunk
    rounds, begin = [], 0
    while begin < database.chunks:
        rounds.append(range(begin, min(begin + size, database.chunks)))
        begin += size
        size *= 2
    return rounds


def tasks(database: Database, settings: GenerationSettings, seed: int, chunks: range) -> Iterator[Chunk]:
    """The tasks of the round with the numbers ``chunks`` that are not done yet, from what ``database`` holds.

    Where the first rows of a chunk exist, since the database has grown, a task has the others.

    They are solved with ``settings``; ``seed`` determines their random guesses.
    """
    problem = database.problem
    payload = cloudpickle.dumps(problem)
    present = database.present()
    missing = [number for number in chunks if not present[number]]
    library = None
    if missing and chunks.start > 0:
        library = Library(database, database.stored_rows(chunks.start).start)
    for number in missing:
        rows, begin = database.missing_rows(number), database.stored_rows(number).start
        p = database.stored_parameters(rows)
        if library is None:
            owner, z = np.empty(0, np.int64), np.empty((0, problem.flat_size), np.float32)
            cold = np.full(len(p), settings.starts)
        else:
            owner, z = library.warm_starts(p, settings)
            # Where no neighbour has a solution, random guesses are all there is.
            warm = np.isin(np.arange(len(p)), owner)
            cold = np.where(warm, settings.cold, max(settings.cold, PATIENCE))
        grown = (rows.start - begin,) if rows.start > begin else ()
        yield Chunk(number, payload, settings, (seed, number, *grown), p, owner, z, cold)
