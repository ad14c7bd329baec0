"""Sets of particular instances: near a discontinuity of the optimum, outside the parameter box, or near the goal.

Each is made in two steps. *Candidates* come from a draw with a seed of their own, most of which a cheap criterion
excludes. They are then solved once more, in a single round of :func:`ocp_envs.generate` that tries every winding of the
goal from many guesses, and of each solution family the lower of the two costs is kept. The set is the first ``size``
candidates, in the order of the draw, that then meet the condition. A set therefore depends only on the problem and the
declaration of the set, and the same call resumes after an interruption.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ocp_envs import tables
from ocp_envs.data.generation import generate
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import off_centre, relative_cost_difference
from ocp_envs.sets.free_paths import blocked
from ocp_envs.sets.near import initial_values, sample_near
from ocp_envs.sets.outside import excess, sample_outside
from ocp_envs.sets.sampling import BlockedDraws, sample
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array

Record = Mapping[str, object]
#: More instances than any set has: all are solved in the first round, from guesses alone.
ONE_ROUND = 10**6
#: Forty guesses for every winding of the goal; small chunks, since each instance takes long.
EXHAUSTIVE = GenerationSettings(first=ONE_ROUND, starts=40, chunk=10)
#: Guesses that bend round a sphere on all sides. IPOPT, since fatrop hangs on every tenth of them; the limit of the
#: iterations is that of the exhaustive search in scripts/check_data.py.
AROUND = replace(EXHAUSTIVE, starts=20, guess="bend", solver=SolverSettings(primary="ipopt", max_iterations=100))
#: As many guesses as for a validation set; no neighbours, which are far away outside the box.
WITHOUT_NEIGHBOURS = replace(EXHAUSTIVE, starts=12)
#: The cheap search looks for families that cost a few per cent more than the best.
CHEAP = GenerationSettings(margin=0.1)


@dataclass(frozen=True, eq=False)
class Candidates:
    """What a set is chosen from.

    Args:
        parameters: (K, np).
        mode_costs: best cost of every family found so far, +inf where none is, (K, modes).
        record: how they were chosen, as JSON.
    """

    parameters: Array
    mode_costs: Array
    record: Record


class HardSet(Protocol):
    """The declaration of a set; those of the benchmark are in :mod:`ocp_envs.sets.splits`."""

    @property
    def size(self) -> int:
        """Number of instances."""

    @property
    def seed(self) -> int:
        """Of the draw and of the guesses."""

    @property
    def settings(self) -> GenerationSettings:
        """Of the solves of the candidates."""

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        """The candidates.

        Args:
            problem: the problem.
            folder: of intermediate databases.
            workers: number of processes; ``None`` for one per core.
        """

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        """Which of the solved candidates meet the condition, (K,).

        Args:
            problem: the problem.
            parameters: of the candidates, (K, np).
            mode_costs: best cost of every family, +inf where none is, (K, modes).
        """


def _unknown(problem: OptimalControlProblem, parameters: Array) -> Array:
    """The costs of candidates ``parameters`` (K, np) that nothing has solved yet, (K, modes)."""
    return np.full((len(parameters), len(problem.modes)), np.inf)


@dataclass(frozen=True)
class NearEqualCosts:
    """Instances whose second-best solution family costs little more than the best.

    Args:
        seed: of the draw and of the guesses.
        drawn: number of parameters to choose from.
        size: number of instances.
        limit: of the relative cost difference (:func:`ocp_envs.sets.discontinuity.relative_cost_difference`).
        slack: the same for a candidate, after the cheap search.
        spare: candidates per instance of the set.
        cheap: settings of the search among the draws.
        settings: of the solves of the candidates.
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
        difference = relative_cost_difference(costs)
        near = np.flatnonzero(difference < self.slack)
        chosen = near[: round(self.spare * self.size)]
        record = {
            "drawn": self.drawn,
            "slack": self.slack,
            "within_slack": len(near),
            "limit": self.limit,
            "share_within_limit": float((difference < self.limit).mean()),
        }
        return Candidates(p[chosen], costs[chosen], record)

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        return np.asarray(relative_cost_difference(mode_costs) < self.limit)


@dataclass(frozen=True)
class NearCentre:
    """Instances whose free path runs close to the centre of the sphere.

    Args:
        seed: of the draw and of the guesses.
        size: number of instances.
        limit: of the distance from the centre, in radii (:func:`ocp_envs.sets.discontinuity.off_centre`).
        slack: the same for the interpolated path, beyond which a draw is not solved.
        block: number of draws at once; about one in 250 is within the limit.
        settings: of the solves of the candidates.
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
        return Candidates(p, _unknown(problem, p), record)

    def _draw(self, problem: OptimalControlProblem) -> tuple[Array, int]:
        """The draws within the limit, (K, np) with K ≥ size, and the number of all draws."""
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
        return np.ones(len(parameters), bool)  # by the draw


@dataclass(frozen=True)
class OutsideBox:
    """Instances outside the parameter box.

    Args:
        seed: of the draw and of the guesses.
        beyond: range of the excess, in half widths (:func:`ocp_envs.sets.outside.excess`).
        size: number of instances.
        settings: of their solves.
    """

    seed: int
    beyond: tuple[float, float] = (0.10, 0.25)
    size: int = 500
    settings: GenerationSettings = WITHOUT_NEIGHBOURS

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        p = sample_outside(problem, self.seed, self.size, self.beyond, workers=workers)
        return Candidates(p, _unknown(problem, p), {"beyond": list(self.beyond)})

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        return excess(problem, parameters) > self.beyond[0]


@dataclass(frozen=True)
class NearGoal:
    """Instances near the goal: the parameter box shrunk towards the goal's state (:mod:`ocp_envs.sets.near`).

    An optimum takes at least the shortest duration of the problem, ``problem.duration[0]``, which decides the cost of
    instances next to the goal. Those of the benchmark take longer: for the pendulum, 0.15 s or more where 0.1 s are
    allowed.

    Args:
        seed: of the draw and of the guesses.
        fraction: of the width of the intervals.
        coordinates: the initial values that are near the goal's; ``None`` for all that are parameters.
        size: number of instances.
        settings: of their solves.
    """

    seed: int
    fraction: float = 0.15
    coordinates: tuple[str, ...] | None = None
    size: int = 1_000
    settings: GenerationSettings = WITHOUT_NEIGHBOURS

    def candidates(self, problem: OptimalControlProblem, folder: Path, workers: int | None) -> Candidates:
        names = self._names(problem)
        p = sample_near(problem, self.seed, self.size, self.fraction, names, workers=workers)
        return Candidates(p, _unknown(problem, p), {"fraction": self.fraction, "coordinates": list(names)})

    def fits(self, problem: OptimalControlProblem, parameters: Array, mode_costs: Array) -> NDArray[np.bool_]:
        return np.ones(len(parameters), bool)  # by the draw

    def _names(self, problem: OptimalControlProblem) -> tuple[str, ...]:
        return initial_values(problem) if self.coordinates is None else self.coordinates
