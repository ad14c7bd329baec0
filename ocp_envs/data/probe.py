"""A probe: a few instances, solved before all others as the first round solves them, and then from each other.

It says what the settings of a generation lead to: how many solves fail, how many of the guesses find the lowest cost,
and how long the whole will take. It chooses nothing, and its solutions are not stored.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ocp_envs.data.settings import GenerationSettings
from ocp_envs.data.worker import Chunk, best_rows, multistart, start_from
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.doors import checked
from ocp_envs.support.kinds import AnyFloat
from ocp_envs.support.progress import Expectation, duration

#: Number of instances of a probe, and seconds after which no further guesses are tried.
PROBED, _PATIENCE = 5, 20.0
#: Two costs that differ by less, relatively, are the same optimum.
_SAME = 1e-3


@checked
@dataclass(frozen=True)
class Probe:
    """What a probe of a few instances found.

    Args:
        statuses: how many instances ended with each status, by its name.
        tried: guesses for each winding that were tried for each instance.
        hits: how many of these found the lowest cost of the instance, for each instance that was solved.
        failures: the fraction of solves that failed.
        scatter: by how much the costs of converged solves of one instance to one winding differ at most, relatively.
        improved: how many of the solved instances became cheaper from the solutions of the others.
        first: seconds that an instance of the first round takes.
        later: seconds that an instance of a later round takes.
    """

    statuses: Mapping[str, int]
    tried: int
    hits: tuple[int, ...]
    failures: AnyFloat
    scatter: AnyFloat
    improved: int
    first: AnyFloat
    later: AnyFloat

    @property
    def text(self) -> str:
        """What was found, in sentences."""
        ended = ", ".join(f"{count} {name}" for name, count in self.statuses.items())
        told = [f"probe of {sum(self.statuses.values())} instances: {ended}; {self.failures:.0%} of the solves fail"]
        if self.hits:
            told.append(
                f"of {self.tried} guesses for each winding {np.mean(self.hits):.1f} find the lowest cost, "
                f"at least {min(self.hits)}; costs to one winding scatter by up to {self.scatter:.1%}"
            )
        if self.doubtful:
            told.append(
                f"{self.doubtful} of {len(self.hits)} lowest costs were found by one guess alone or are beaten from a "
                "neighbour's solution: more guesses (settings.starts) may find lower ones, and so does ocp_envs.refine"
            )
        told.append(
            f"an instance of the first round takes {_short(self.first)} on one core, a later one {_short(self.later)}"
        )
        return "; ".join(told)

    @property
    def doubtful(self) -> int:
        """Of how many solved instances a single guess found the lowest cost, or the others' solutions a lower one."""
        single = sum(hits == 1 for hits in self.hits) if self.tried > 1 else 0
        return max(single, self.improved)

    def expectation(self, first: int, workers: int) -> Expectation:
        """How long a generation takes whose first round has ``first`` instances, with ``workers``."""
        cold, warm = self.first, self.later
        return Expectation(lambda done: cold * min(done, first) + warm * max(done - first, 0), workers)


def _short(seconds: float) -> str:
    return f"{1000 * seconds:.0f} ms" if seconds < 1 else f"{seconds:.1f} s" if seconds < 60 else duration(seconds)


def probe(solver: GuardedSolver, parameters: Array, settings: GenerationSettings, seed: int = 0) -> Probe:
    """Solve the instances with ``parameters`` (B, np), B ≥ 1, as a first round with ``settings``, then from each other.

    They are few. The ``solver`` is that of the problem; ``seed`` determines the guesses.
    """
    hopeless, count = infeasible_rows(solver.problem, parameters), len(parameters)
    owner, solutions, lowest, seconds = _first_round(solver, parameters, list(hopeless), settings, seed)
    best, tried = lowest.min(axis=0, initial=np.inf), max(len(lowest), 1)
    solved = np.isfinite(best)
    with np.errstate(invalid="ignore"):
        hits = (lowest <= best + _SAME * np.abs(best)).sum(axis=0)[solved]
    first = seconds / max(count - len(hopeless), 1) * settings.starts / tried
    later, improved = _from_each_other(solver, parameters, owner, solutions, best, settings.neighbours)
    return Probe(
        statuses=_statuses(owner, solutions, solved, list(hopeless)),
        tried=len(lowest),
        hits=tuple(hits.tolist()),
        failures=float(1 - solutions.solved.mean()) if len(solutions) else 0.0,
        scatter=_scatter(solver.problem.targets, owner, solutions),
        improved=improved,
        first=first,
        later=first if later is None else later,
    )


def _first_round(
    solver: GuardedSolver, parameters: Array, hopeless: list[int], settings: GenerationSettings, seed: int
) -> tuple[Ints, Solutions, Array, float]:
    """The instance of each of S solves (S,), S solutions, lowest costs (guesses, B), and the seconds that they took."""
    problem, count = solver.problem, len(parameters)
    nothing = np.empty(0, np.int64), np.empty((0, problem.flat_size), np.float32)
    cold = np.where(np.isin(np.arange(count), hopeless), 0, settings.starts)
    owners, found, lowest, began = [nothing[0]], [Solutions.empty(problem, 0)], [], time.perf_counter()
    for owner, solutions in multistart(solver, Chunk(0, b"", settings, (seed,), parameters, *nothing, cold)):
        owners.append(owner)
        found.append(solutions)
        lowest.append(_lowest(owner, solutions.cost, count))
        if time.perf_counter() - began > _PATIENCE:
            break
    seconds = time.perf_counter() - began
    costs = np.array(lowest).reshape(len(lowest), count)
    return np.concatenate(owners), Solutions.concatenate(found), costs, seconds


def _lowest(owner: Ints, cost: Array, count: int) -> Array:
    """The lowest ``cost`` of the solves of each of ``count`` instances, given the instance of each solve."""
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, owner, cost)
    return lowest


def _statuses(owner: Ints, solutions: Solutions, solved: Bools, hopeless: list[int]) -> dict[str, int]:
    """How many instances ended how; an unsolved one as its first solve did."""
    ended = []
    for row, good in enumerate(solved):
        status = Status.SOLVED if good else Status.INFEASIBLE
        if not good and row not in hopeless:
            status = Status(int(solutions.status[owner == row][0]))
        ended.append(status.name)
    return dict(Counter(ended))


def _scatter(targets: Array, owner: Ints, solutions: Solutions) -> float:
    """The largest relative difference of costs of one instance to one winding."""
    ends = solutions.trajectory.states[:, -1, None] - targets
    winding = np.where(solutions.solved, np.abs(ends).sum(axis=2).argmin(axis=1), -1)
    largest = 0.0
    for row, wound in {(i, w) for i, w in zip(owner.tolist(), winding.tolist()) if w >= 0}:
        cost = solutions.cost[(owner == row) & (winding == wound)]
        largest = max(largest, float((cost.max() - cost.min()) / np.abs(cost).min()))
    return largest


def _from_each_other(
    solver: GuardedSolver, parameters: Array, owner: Ints, solutions: Solutions, best: Array, neighbours: int
) -> tuple[float | None, int]:
    """Seconds for an instance that is solved from the solutions of some ``neighbours``, and how many become cheaper.

    The ``best`` costs (B,) are those that are known. The time is unknown where there is no solution of another.
    """
    problem, count = solver.problem, len(parameters)
    rows = best_rows(problem, parameters, owner, solutions)
    row, mode = np.nonzero(np.isfinite(rows.cost))
    if not len(row) or count < 2:
        return None, 0
    others = [(row + step) % count for step in range(1, min(neighbours, count - 1) + 1)]
    wanted, z = np.concatenate(others), np.tile(rows.z[row, mode], (len(others), 1))
    p, began = parameters[wanted], time.perf_counter()
    again = solver.solve(p, start_from(problem, p, z), np.full(len(p), NEAREST_WINDING), retry_with_fallback=False)
    seconds = (time.perf_counter() - began) / len(np.unique(wanted))
    with np.errstate(invalid="ignore"):
        improved = _lowest(wanted, again.cost, count) < best - _SAME * np.abs(best)
    return seconds, int((improved & np.isfinite(best)).sum())
