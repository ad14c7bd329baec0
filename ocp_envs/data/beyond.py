"""The optimum of each family beyond the family's border: where it still exists and costs little more than the best.

A family of samples is continued across its border: at a neighbour in another family the solver begins with the family's
trajectory, and from there at the neighbour's neighbours, as far as the cost exceeds the best one by at most a margin. A
trajectory that is found counts unless it is one of another family that is known there, which says that the family has
ended.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ocp_envs.data.continuation import DISTANCE, distance
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.data.worker import start_from
from ocp_envs.solvers.check import residuals
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.solver import OF_MANY_GUESSES, GuardedSolver
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.checks import check_number
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: Largest excess of the cost beyond a border, and neighbours along which families are continued.
MARGIN, _NEIGHBOURS = 0.1, 8
#: (parameters (B, np), guesses) → trajectories, their costs (B,), +inf where nothing was found.
Continue = Callable[[Array, Trajectory], tuple[Trajectory, Array]]


@checked
@dataclass(frozen=True, eq=False)
class Beyond:
    """The best trajectories of k families of M samples.

    Args:
        best: cost of every sample, (M,).
        cost: of every family at every sample, (M, k); +inf where none is known.
        rows: samples of the E trajectories beyond the border of their family, (E,).
        family: of these, (E,).
        trajectory: these trajectories.
        solves: number of solves.
    """

    best: Array
    cost: Array
    rows: Ints
    family: Ints
    trajectory: Trajectory
    solves: int

    def __repr__(self) -> str:
        samples, families = self.cost.shape
        return (
            f"<Beyond: {len(self.rows)} trajectories of {families} families of {samples} samples, {self.solves} solves>"
        )

    @property
    def excess(self) -> Array:
        """The value gap ``(J_k − J*) / |J*|`` of every family at every sample, (M, k); +inf where it is not known."""
        best = self.best[:, None]
        return np.asarray((self.cost - best) / np.abs(best))


@checked
def beyond(
    database: Samples | SampleSource,
    families: Ints,
    margin: float = MARGIN,
    *,
    pairs: Ints | None = None,
    solve: Continue | None = None,
) -> Beyond:
    """Continue the ``families`` of samples across their borders.

    Args:
        database: a Database or its samples, M of them.
        families: of each, (M,) integers in 0 … k − 1, such as the ``families`` of :func:`moe_policy.cluster`; −1 for a
            trajectory of none.
        margin: largest excess of the cost over the best one, relative to it.
        pairs: rows of neighbouring samples, (E, 2); by default each and its eight nearest in p, every coordinate
            divided by the width of its box.
        solve: continues trajectories; by default the solver, in a process of its own.

    Raises:
        ValueError: families that are not one for each sample, or a margin that is not above 0.
    """
    samples, families = samples_of(database), np.asarray(families)
    check_number("margin", margin, "a number above 0", 0.0)
    if families.shape != (len(samples),) or not -1 <= families.min() <= families.max():
        raise ValueError(f"families: expected integers ({len(samples)},) from -1, got {families!r:.99}")
    if pairs is None:
        pairs = neighbour_pairs(samples.problem.parameters, samples.parameters, _NEIGHBOURS)
    if solve is None:
        with GuardedSolver(samples.problem, OF_MANY_GUESSES) as solver:
            return beyond(samples, families, margin, pairs=pairs, solve=_by(solver))
    search = _Search(samples, families, margin, solve)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    length = np.linalg.norm(
        (samples.parameters[both[:, 0]] - samples.parameters[both[:, 1]]) / samples.problem.parameters.width, axis=1
    )
    both = both[np.argsort(length, kind="stable")]
    while search.fresh.any():
        search.advance(both)
    return search.found()


def _by(solver: GuardedSolver) -> Continue:
    problem = solver.problem

    def solve(p: Array, guess: Trajectory) -> tuple[Trajectory, Array]:
        warm = start_from(problem, p, guess.flat())
        found = solver.solve(p, warm, np.full(len(p), NEAREST_WINDING), retry_with_fallback=False, rescue=False)
        return found.trajectory, np.where(found.solved, found.cost, np.inf)

    return solve


class _Search:
    """What is known of every family, and where it became known last."""

    def __init__(self, samples: Samples, families: Ints, margin: float, solve: Continue) -> None:
        self.samples, self.margin, self.solve = samples, margin, solve
        count, k = len(samples), int(families.max()) + 1
        own = np.flatnonzero(families >= 0)
        families = families[own]
        _, best = residuals(samples.problem, samples.parameters, samples.trajectory)
        self.best: Array = best
        self.cost: Array = np.full((count, k), np.inf)
        self.cost[own, families] = best[own]
        #: number of the trajectory of every family at every sample among all, −1 for none
        self.place: Ints = np.full((count, k), -1)
        self.place[own, families] = np.arange(len(own))
        self.fresh: Bools = self.place >= 0
        self.tried = 0
        self.rows, self.families = [own], [np.asarray(families)]
        self.flat: list[Array] = [samples.trajectory[own].flat()]

    def advance(self, edges: Ints) -> None:
        """Continue along the directed ``edges`` (2E, 2), the shortest first, what became known last."""
        place, family = self._wanted(edges)
        self.fresh[:] = False
        if not len(place):
            return
        guesses, rows = np.concatenate(self.flat)[place[:, 0]], place[:, 1]
        problem, p = self.samples.problem, self.samples.parameters[rows]
        trajectory, cost = self.solve(p, problem.unflatten(guesses))
        self.tried += len(rows)
        good = cost <= self.best[rows] + self.margin * np.abs(self.best[rows])
        good[good] = ~self._elsewhere(trajectory[good], rows[good])
        rows, family = rows[good], family[good]
        self.place[rows, family] = sum(map(len, self.rows)) + np.arange(len(rows))
        self.cost[rows, family], self.fresh[rows, family] = cost[good], True
        self.rows.append(rows)
        self.families.append(family)
        self.flat.append(trajectory[good].flat())

    def _wanted(self, edges: Ints) -> tuple[Ints, Ints]:
        """The number of a known trajectory and the sample at which it is continued, (B, 2), and its family (B,)."""
        wanted, families = [], []
        for family in range(self.cost.shape[1]):
            first, last = edges[self.fresh[edges[:, 0], family] & (self.place[edges[:, 1], family] < 0)].T
            rows, shortest = np.unique(last, return_index=True)
            wanted.append(np.stack([self.place[first[shortest], family], rows], axis=1))
            families.append(np.full(len(rows), family))
        return np.concatenate(wanted), np.concatenate(families)

    def _elsewhere(self, found: Trajectory, rows: Ints) -> Bools:
        """Which trajectories ``found`` at samples ``rows`` are those of another family that is known there, (B,)."""
        known, same = np.concatenate(self.flat), np.zeros(len(rows), bool)
        for family in range(self.cost.shape[1]):
            there = np.flatnonzero(self.place[rows, family] >= 0)
            other = self.samples.problem.unflatten(known[self.place[rows[there], family]])
            same[there] |= distance(self.samples.problem, found[there], other) <= DISTANCE
        return same

    def found(self) -> Beyond:
        """All that is known."""
        count = len(self.rows[0])
        rows, families = np.concatenate(self.rows)[count:], np.concatenate(self.families)[count:]
        flat = np.concatenate(self.flat)[count:]
        return Beyond(self.best, self.cost, rows, families, self.samples.problem.unflatten(flat), self.tried)
