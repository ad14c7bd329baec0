"""Generation of hard sets by the procedure that :mod:`ocp_envs.sets.hard_sets` describes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ocp_envs.data.generation import generate
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.hard_sets import HardSet, NearEqualCosts, Record
from ocp_envs.sets.reference import ReferenceSet
from ocp_envs.support.arrays import Array

#: Relative difference above which two costs count as different.
DIFFERENT = 1e-3


def smaller(hard: HardSet, size: int) -> HardSet:
    """``hard`` with ``size`` instances, generated from fewer draws, for a quick trial."""
    if isinstance(hard, NearEqualCosts):
        # In a small draw the fraction near the discontinuity may be smaller.
        return replace(hard, size=size, drawn=2 * -(-hard.drawn * size // hard.size))
    return replace(hard, size=size)  # type: ignore[type-var]


def make(
    problem: OptimalControlProblem, name: str, hard: HardSet, folder: Path, workers: int | None = None
) -> tuple[ReferenceSet, Record]:
    """The set that ``hard`` declares, with its reference costs, and a record of its making.

    Args:
        problem: the problem.
        name: of the set, and of its database in ``folder``.
        hard: the declaration.
        folder: of the databases; the same call resumes after an interruption.
        workers: number of processes; ``None`` for one per core.

    Raises:
        RuntimeError: fewer instances than wanted meet the condition and have a solution.
    """
    found = hard.candidates(problem, folder, workers)
    path, p = folder / f"{name}.zarr", found.parameters
    database = generate(problem, path, p, workers=workers, seed=hard.seed, settings=hard.settings, extrapolate=True)
    solved = database.costs()
    costs = np.minimum(solved, found.mode_costs)
    good = np.isfinite(costs).any(axis=1) & hard.fits(problem, p, costs)
    chosen = np.flatnonzero(good)[: hard.size]
    if len(chosen) < hard.size:
        raise RuntimeError(
            f"{problem.id}: {len(chosen)} of {len(p)} candidates for {name!r} meet its condition and have a solution, "
            f"{hard.size} are wanted; declare it with more candidates"
        )
    record = {
        "seed": hard.seed,
        "size": hard.size,
        **found.record,
        "candidates": len(p),
        "confirmed": int(good.sum()),
        "unsolved": int((~np.isfinite(costs).any(axis=1)).sum()),
        "guesses_per_winding": hard.settings.starts,
        "search": _compared(solved, found.mode_costs),
        "solves": database.totals(),
        "settings": database.settings,
    }
    return ReferenceSet(p[chosen], costs[chosen]), record


def _compared(search: Array, cheap: Array) -> Record | None:
    """How often search and choice of candidates found a lower best cost, (K, modes) each; ``None`` without costs."""
    both = np.isfinite(cheap).any(axis=1)
    if not both.any():
        return None
    ratio = search[both].min(axis=1) / cheap[both].min(axis=1)
    return {
        "tolerance": DIFFERENT,
        "compared": int(both.sum()),
        "found_better": int((ratio < 1 - DIFFERENT).sum()),
        "missed": int((ratio > 1 + DIFFERENT).sum()),
    }
