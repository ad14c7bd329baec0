"""Sets of problems chosen for being hard: close to the jump of the optimum, or outside the parameter box.

Each is made in two steps. *Candidates* come from a draw with a seed of their own, most of them sorted out by a cheap
figure. They are solved again, in one round of :func:`ocp_envs.generate` in which every winding of the goal is tried
from many guesses, and of every mode the better of both costs is kept. The first ``size`` of those that then meet the
condition, in the order of the draw, are the set. So a set depends on the problem and its declaration alone, and a call
that was interrupted goes on from there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ocp_envs import tables
from ocp_envs.data.generation import generate
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import off_centre, relative_cost_difference
from ocp_envs.sets.free_paths import blocked
from ocp_envs.sets.outside import excess, sample_outside
from ocp_envs.sets.reference import Reference
from ocp_envs.sets.sampling import BlockedDraws, sample
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array

Record = dict[str, Any]
#: More problems than any set has: all are in the first round, where nothing but guesses is started from.
ONE_ROUND = 10**6
#: Forty guesses for every winding of the goal, and small chunks, as each takes long.
EXHAUSTIVE = GenerationSettings(first=ONE_ROUND, starts=40, chunk=10)
#: Where a sphere is to be passed on all sides, in bends. IPOPT, as fatrop hangs on every tenth of them; the iterations
#: are those of the exhaustive search in scripts/check_data.py.
AROUND = replace(EXHAUSTIVE, starts=20, guess="bend", solver=SolverSettings(primary="ipopt", max_iterations=100))
#: Guesses as for a validation set; no neighbours, which outside the box are far away.
WITHOUT_NEIGHBOURS = replace(EXHAUSTIVE, starts=12)
#: What the cheap search is for are modes that cost a few per cent more.
CHEAP = GenerationSettings(margin=0.1)
#: Relative difference from which two costs count as different.
DIFFERENT = 1e-3


@dataclass(frozen=True, eq=False)
class Candidates:
    """What a set is chosen from.

    Args:
        parameters: (K, np).
        mode_costs: best cost of every mode found so far, +inf where none, (K, modes).
        record: what the choice took, as JSON.
    """

    parameters: Array
    mode_costs: Array
    record: Record


class HardSet(Protocol):
    """How a set is made; its values are declared in :mod:`ocp_envs.sets.splits`."""

    @property
    def size(self) -> int:
        """Number of problems."""

    @property
    def seed(self) -> int:
        """Of the draw and the guesses."""

    @property
    def settings(self) -> GenerationSettings:
        """How the candidates are solved."""

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        """The candidates; intermediate databases go to ``folder``."""

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        """Which of the solved candidates meet the condition, (K,)."""


@dataclass(frozen=True)
class NearJump:
    """Problems whose second-best mode costs hardly more than the best.

    Args:
        seed: of the draw and the guesses.
        drawn: uniform parameters to choose among.
        size: number of problems.
        limit: largest gap (:func:`ocp_envs.sets.discontinuity.gaps`).
        slack: largest gap of a candidate in the cheap search.
        spare: candidates for each problem of the set.
        cheap: how the draws are solved.
        settings: how the candidates are.
    """

    seed: int
    drawn: int
    size: int = 500
    limit: float = 0.03
    slack: float = 0.04
    spare: float = 1.45
    cheap: GenerationSettings = CHEAP
    settings: GenerationSettings = EXHAUSTIVE

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        p = sample(problem, self.seed, self.drawn, workers=workers)
        path = folder / "boundary-candidates.zarr"
        costs = generate(problem, path, p, workers=workers, seed=self.seed, settings=self.cheap).costs()
        gap = relative_cost_difference(costs)
        near = np.flatnonzero(gap < self.slack)
        chosen = near[: round(self.spare * self.size)]
        record = {
            "drawn": self.drawn,
            "slack": self.slack,
            "within_slack": len(near),
            "limit": self.limit,
            "share_within_limit": float((gap < self.limit).mean()),
        }
        return Candidates(p[chosen], costs[chosen], record)

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        return np.asarray(relative_cost_difference(mode_costs) < self.limit)


@dataclass(frozen=True)
class NearCentre:
    """Problems whose free path runs close to the centre of the sphere.

    Args:
        seed: of the draw and the guesses.
        size: number of problems.
        limit: largest distance from the centre, in radii (:func:`ocp_envs.sets.discontinuity.off_centre`).
        slack: largest distance of the interpolated path of a draw that is solved.
        block: draws at once; about one in 250 comes so close.
        settings: how the candidates are solved.
    """

    seed: int
    size: int = 500
    limit: float = 0.1
    slack: float = 0.12
    block: int = 5_000
    settings: GenerationSettings = AROUND

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        try:
            kept = tables.load(problem, "boundary-candidates", folder)
        except tables.TableError:
            kept = {}
        if str(kept.get("declared")) != repr(self):
            found, drawn = self._draw(problem)
            kept = {"parameters": found, "drawn": np.array(drawn), "declared": np.array(repr(self))}
            tables.save(problem, "boundary-candidates", folder, **kept)
        p, drawn = np.asarray(kept["parameters"], dtype=np.float64), int(kept["drawn"])
        record = {"drawn": drawn, "limit": self.limit, "share_within_limit": len(p) / drawn}
        p = p[: self.size]
        return Candidates(p, np.full((len(p), len(problem.modes)), np.inf), record)

    def _draw(self, problem: OptimalControlProblem) -> tuple[Array, int]:
        """All that come so close in the first draws, (K, np) with K ≥ size, and the number of these draws."""
        parts: list[Array] = []
        drawn = 0
        with BlockedDraws(problem, self.seed) as draw, GuardedSolver(blocked(problem).free) as solver:
            while sum(map(len, parts)) < self.size:
                p = draw(drawn, drawn + self.block)
                drawn += self.block
                p = p[off_centre(problem, p) < self.slack]
                parts.append(p[off_centre(problem, p, solver) < self.limit])
        return np.concatenate(parts), drawn

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        return np.ones(len(parameters), bool)  # the draw has seen to it


@dataclass(frozen=True)
class OutsideBox:
    """Problems beyond the parameter box.

    Args:
        seed: of the draw and the guesses.
        beyond: least and largest excess, in half widths (:func:`ocp_envs.sets.outside.excess`).
        size: number of problems.
        settings: how they are solved.
    """

    seed: int
    beyond: tuple[float, float] = (0.10, 0.25)
    size: int = 500
    settings: GenerationSettings = WITHOUT_NEIGHBOURS

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        p = sample_outside(problem, self.seed, self.size, self.beyond, workers=workers)
        costs = np.full((len(p), len(problem.modes)), np.inf)
        return Candidates(p, costs, {"beyond": list(self.beyond)})

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        return excess(problem, parameters) > self.beyond[0]


def smaller(hard: HardSet, size: int) -> HardSet:
    """``hard`` with ``size`` problems, made of fewer draws: to try things out."""
    changed: Any = replace(hard, size=size)  # type: ignore[type-var]
    # Of few draws more than their share may be far from the jump.
    return replace(changed, drawn=2 * -(-hard.drawn * size // hard.size)) if isinstance(hard, NearJump) else changed


def make(
    problem: OptimalControlProblem, name: str, hard: HardSet, folder: Path, workers: int | None = None
) -> tuple[Reference, Record]:
    """The set ``hard`` of ``problem`` with its reference costs, and what it took.

    Args:
        problem: the problem.
        name: of the set, and of its database in ``folder``.
        hard: how it is made.
        folder: of the databases; a call that was interrupted goes on from there.
        workers: processes; one per core by default.

    Raises:
        RuntimeError: fewer problems than wanted meet the condition and have a solution.
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
    return Reference(p[chosen], costs[chosen]), record


def _compared(search: Array, cheap: Array) -> Record | None:
    """How often the search and the choice of candidates found a better best cost; ``None`` without costs to compare."""
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
