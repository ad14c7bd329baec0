"""How planners do on the splits of a problem, and how that depends on the distance from the jump of the optimum.

The splits are ``uniform`` (the validation set), ``boundary`` and ``outside`` (:mod:`ocp_envs.sets.splits`); the
distance is
that of :mod:`ocp_envs.sets.discontinuity`. Problems of ``uniform`` and ``boundary`` are put together and sorted into
bins of
equal ratio of the distance. Both sets are uniform where they overlap, so that a bin of both is one of uniform problems
at that distance. A bin has a share of successes with Wilson's interval, or a mean violation with Student's

    m ± t_{0.975, n−1} s / √n,     not below 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from moe_policy.experiments.tables import DASH, keyed, proportion
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Mean, Proportion
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

Record = dict[str, Any]

#: The splits in the order of tables and figures, each with the reference set it is.
SPLITS = {"uniform": "validation", "boundary": "boundary", "outside": "outside"}
#: Those whose problems make the curves.
BINNED = ("uniform", "boundary")
#: Of the bins: how many in a factor of ten, and how few problems one may have.
PER_DECADE, LEAST = 4, 25
_TINY = 1e-9


def metrics_of(problem: OptimalControlProblem) -> dict[str, str]:
    """What is judged on ``problem``, with the label of its axis; keys are those of the rows of a comparison.

    Where there is an obstacle nearly every plan ends at the goal, and what tells planners apart is how far they cut
    through it.
    """
    if problem.n_clearances:
        return {
            "knot_violation_mean": "mean violation at the plan's knots, m",
            "violation_mean": "mean violation on the whole path, m",
        }
    if problem.hold == 0:
        return {"success": "success at the plan's end, %"}
    return {"success_at_plan_end": "success at the plan's end, %", "success": "success after the hold, %"}


# -- curves ------------------------------------------------------------------------------------------------------------


def log_bins(distances: Array, per_decade: int = PER_DECADE, least: int = LEAST) -> Array:
    """Edges (K + 1,) of bins with equal ratios, neighbours joined until each has ``least`` of ``distances`` (B,).

    The last bin takes what is left over. Fewer than ``least`` distances are one bin.

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
        if inside >= least:
            edges.append(right)
            inside = 0
    if inside:
        edges = [*(edges[:-1] or edges), grid[-1]]
    return np.array(edges)


def outcomes(problem: OptimalControlProblem, episodes: Episodes, metric: str) -> Array | NDArray[np.bool_] | None:
    """What ``metric`` of :func:`metrics_of` counts, by episode, (B,); ``None`` where there is no plan to judge."""
    planned = bool(np.isfinite(episodes.plan_end_error).any())
    values: Mapping[str, Callable[[], Any]] = {
        "success": lambda: episodes.success,
        "success_at_plan_end": lambda: episodes.plan_end_error < problem.goal.radius if planned else None,
        "violation_mean": lambda: episodes.violation,
        "knot_violation_mean": lambda: episodes.knot_violation if planned else None,
    }
    return values[metric]()


def curves(problem: OptimalControlProblem, distances: Array, episodes: Mapping[str, Episodes]) -> Record:
    """How each policy does at which distance from the jump, as JSON.

    Args:
        problem: the problem.
        distances: of the episodes' problems from the jump, (B,); those that are not finite are left out and counted.
        episodes: by the name of the policy, B each, all from the same starts.

    Returns:
        ``edges`` of the bins; the problems and the geometric mean of the distances of each; and under ``metrics``, by
        metric and policy, a record for each bin.
    """
    known = np.isfinite(distances)
    inside = np.maximum(distances[known], _TINY)
    edges = log_bins(inside)
    place = np.clip(np.searchsorted(edges, inside, side="right") - 1, 0, len(edges) - 2)
    rows = [np.flatnonzero(known)[place == i] for i in range(len(edges) - 1)]
    metrics: Record = {}
    for metric in metrics_of(problem):
        judged = {name: outcomes(problem, found, metric) for name, found in episodes.items()}
        metrics[metric] = {
            name: [_bin(values[chosen]) for chosen in rows] for name, values in judged.items() if values is not None
        }
    return {
        "edges": edges,
        "problems": [len(chosen) for chosen in rows],
        "distance": [float(np.exp(np.log(inside[place == i]).mean())) for i in range(len(rows))],
        "distance_unknown": int((~known).sum()),
        "metrics": metrics,
    }


def _bin(values: NDArray[Any]) -> Record | None:
    found = Proportion.of(values) if values.dtype == bool else Mean.of(values)
    return None if found is None else found.to_json()


def judged(problem: OptimalControlProblem, episodes: Episodes) -> Record:
    """Every metric of ``problem`` over all ``episodes`` with its interval, as JSON; ``None`` without a judged plan."""
    values = {metric: outcomes(problem, episodes, metric) for metric in metrics_of(problem)}
    return {metric: None if found is None else _bin(found) for metric, found in values.items()}


# -- separation --------------------------------------------------------------------------------------------------------


def disjoint(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether the intervals of two shares or means, as JSON, have no point in common."""
    (low, high), (lower, higher) = one["interval"], other["interval"]
    return bool(high < lower or higher < low)


def separations(problem: OptimalControlProblem, rows: Mapping[str, Mapping[str, Any]]) -> list[Record]:
    """Whether figures of the single network and of each mixture differ by more than their intervals, as JSON.

    Args:
        problem: the problem.
        rows: by the name of the planner, with what :func:`judged` tells under ``judged``.
    """
    found = []
    for metric in metrics_of(problem):
        for name, row in rows.items():
            if name.startswith("moe-") and "snn" in rows:
                apart = disjoint(rows["snn"]["judged"][metric], row["judged"][metric])
                found.append({"metric": metric, "mixture": name, "disjoint": apart})
    return found


# -- table -------------------------------------------------------------------------------------------------------------


def _cell(key: str, form: Callable[[Any], str]) -> Callable[[Mapping[str, Any]], str]:
    return lambda row: DASH if row.get(key) is None else form(row[key])


def _share(record: Mapping[str, Any]) -> str:
    return f"{proportion(Proportion(record['count'], record['total']))} of {record['total']:,}"


def _ratio(record: Mapping[str, Any]) -> str:
    return DASH if record["ratio"] is None else f"{record['ratio']:.3f}"


_SHOWN: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("success_at_plan_end", "at the plan's end (95 % interval)", _share),
    ("success", "success", _share),
    ("knot_violation_mean", "mean violation at knots, m", "{:.3f}".format),
    ("violation_mean", "… on the whole path", "{:.3f}".format),
    ("cost_ratio", "cost / optimal", _ratio),
)
#: One row for each policy, whose figures on a split stand under the split's name.
SPLIT_COLUMNS = (
    keyed("name", "policy"),
    *(keyed(split, f"{split}: {title}", _cell(key, form)) for split in SPLITS for key, title, form in _SHOWN),
)
