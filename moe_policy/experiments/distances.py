"""Metrics of methods against the distance of an instance from the discontinuity of the optimum.

The distance is that of :mod:`ocp_envs.sets.discontinuity`. Instances are sorted into bins of equal ratio of the
distance. A bin has a fraction of successes with Wilson's interval, or a mean violation with Student's
(:mod:`moe_policy.rollouts.intervals`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from moe_policy.reports.records import Record
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Estimate, Mean, Proportion
from moe_policy.rollouts.metrics import TOLERANCES
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools

#: Bins in a factor of ten, and minimum number of instances in a bin.
PER_DECADE, MINIMUM = 4, 25
_TINY = 1e-9


@dataclass(frozen=True)
class Measure:
    """What is measured on a problem."""

    name: str  # that of the metric in a comparison
    label: str  # of its axis
    #: values by episode, (B,): flags that are counted or numbers that are averaged; ``None`` without plans
    of: Callable[[OptimalControlProblem, Episodes], Array | Bools | None]

    def estimate(self, problem: OptimalControlProblem, episodes: Episodes) -> Estimate | None:
        """The fraction or the mean over ``episodes`` of ``problem``; ``None`` without plans."""
        return _estimate(self.of(problem, episodes))


def _estimate(values: Array | Bools | None) -> Estimate | None:
    if values is None:
        return None
    return Proportion.of(values.astype(bool)) if values.dtype == bool else Mean.of(values)


def _planned(episodes: Episodes) -> bool:
    return bool(np.isfinite(episodes.plan_end_error).any())


def _at_plan_end(problem: OptimalControlProblem, episodes: Episodes) -> Bools | None:
    return episodes.plan_end_error < problem.goal.radius if _planned(episodes) else None


def _clear(tolerance: float) -> Measure:
    text = f"{100 * tolerance:g} cm"
    return Measure(
        f"success_clear_{tolerance:g}",
        f"ends at the goal and enters at most {text}, %",
        lambda _, episodes: episodes.success & episodes.clear(tolerance),
    )


def measures_of(problem: OptimalControlProblem) -> tuple[Measure, ...]:
    """What is measured on ``problem``, the hardest measure first.

    Where there is an obstacle nearly every plan ends at the goal; planners differ in whether they enter the obstacle,
    and how deep.
    """
    if problem.n_clearances:
        violation = Measure("violation_mean", "mean violation on the whole path, m", lambda _, e: e.violation)
        return (*map(_clear, TOLERANCES), violation)
    if problem.hold == 0:
        return (Measure("success", "success at the plan's end, %", lambda _, episodes: episodes.success),)
    return (
        Measure("success_at_plan_end", "success at the plan's end, %", _at_plan_end),
        Measure("success", "success after terminal regulation, %", lambda _, episodes: episodes.success),
    )


def log_bins(distances: Array, per_decade: int = PER_DECADE, minimum: int = MINIMUM) -> Array:
    """Edges (K + 1,) of bins of ``distances`` (B,) with equal ratios, ``per_decade`` of them in a factor of ten.

    Neighbours are merged until each has ``minimum`` distances. The last bin takes the remainder; fewer are one bin.

    Raises:
        ValueError: no distances, or one that is not positive and finite.
    """
    if not len(distances) or not (np.isfinite(distances).all() and (distances > 0).all()):
        raise ValueError("expected at least one distance, all positive and finite")
    first, last = np.floor(np.log10(distances.min())), np.ceil(np.log10(distances.max()))
    last = max(last, first + 1)
    grid = np.logspace(first, last, per_decade * int(last - first) + 1)
    grid[0], grid[-1] = min(grid[0], distances.min()), max(grid[-1], distances.max())  # powers of ten are rounded
    counts = np.histogram(distances, grid)[0]
    edges, inside = [grid[0]], 0
    for count, right in zip(counts, grid[1:]):
        inside += count
        if inside >= minimum:
            edges.append(right)
            inside = 0
    if inside:
        edges = [*(edges[:-1] or edges), grid[-1]]
    return np.array(edges)


@dataclass(frozen=True, kw_only=True)
class DistanceCurves(Record):
    """Metrics against the distance from the discontinuity."""

    edges: tuple[float, ...]  # of the K bins, K + 1 distances
    problems: tuple[int, ...]  # number of instances in each bin
    distance: tuple[float, ...]  # geometric mean of the distances in each bin
    distance_unknown: int  # number of instances whose distance is not known, which are left out
    metrics: dict[str, dict[str, tuple[Estimate | None, ...]]]  # by measure and method, one estimate for each bin

    @classmethod
    def of(cls, problem: OptimalControlProblem, distances: Array, episodes: Mapping[str, Episodes]) -> Self:
        """The curves of ``episodes`` by method, B each, over ``distances`` (B,), not finite where unknown."""
        known = np.isfinite(distances)
        inside = np.maximum(distances[known], _TINY)
        edges = log_bins(inside)
        place = np.clip(np.searchsorted(edges, inside, side="right") - 1, 0, len(edges) - 2)
        rows = [np.flatnonzero(known)[place == i] for i in range(len(edges) - 1)]
        metrics: dict[str, dict[str, tuple[Estimate | None, ...]]] = {}
        for measure in measures_of(problem):
            values = {name: measure.of(problem, found) for name, found in episodes.items()}
            metrics[measure.name] = {
                name: tuple(_estimate(found[chosen]) for chosen in rows)
                for name, found in values.items()
                if found is not None
            }
        return cls(
            edges=tuple(float(edge) for edge in edges),
            problems=tuple(len(chosen) for chosen in rows),
            distance=tuple(float(np.exp(np.log(inside[place == i]).mean())) for i in range(len(rows))),
            distance_unknown=int((~known).sum()),
            metrics=metrics,
        )

    def with_methods(self, other: DistanceCurves, names: Collection[str]) -> DistanceCurves:
        """These curves with those of ``names`` in ``other``, on the same instances."""
        metrics = {
            measure: found | {name: bins for name, bins in other.metrics[measure].items() if name in names}
            for measure, found in self.metrics.items()
        }
        return replace(self, metrics=metrics)
