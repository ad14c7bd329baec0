"""Training curves over seeds.

The median over n seeds is drawn with their minimum and maximum (:class:`moe_policy.rollouts.intervals.Spread` says how
often these enclose the median of all seeds).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.learners import LearnerRun
from moe_policy.experiments.records import Record, present
from ocp_envs.support.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Curve(Record):
    """A training curve: one value for each evaluation on the development set, ``None`` where it was not kept."""

    seed: int  # of the training
    steps: tuple[int, ...]  # decisions learnt from
    seconds: tuple[float, ...]  # wall time of the training
    success: tuple[float, ...]  # fraction of the episodes in the goal ball at the evaluation time
    cost_ratio: tuple[float | None, ...]  # Σ cost / Σ optimal cost over the successes
    mean_return: tuple[float | None, ...]  # mean undiscounted return
    violation: tuple[float | None, ...]  # mean of the maximum violation of the path constraints

    @classmethod
    def of(cls, run: LearnerRun) -> Self:
        """The curve of ``run``."""
        return cls(
            seed=run.learner.seed,
            steps=tuple(point.steps for point in run.curve),
            seconds=tuple(point.seconds for point in run.curve),
            success=tuple(point.success / run.development.count for point in run.curve),
            cost_ratio=tuple(present(point.cost_ratio) for point in run.curve),
            mean_return=tuple(present(point.mean_return) for point in run.curve),
            violation=tuple(present(point.violation) for point in run.curve),
        )


def over_seeds(curves: Iterable[tuple[Sequence[float], Sequence[float | None]]]) -> tuple[Array, Array]:
    """The curves of all seeds at common points: (points (G,), values (S, G)).

    Between evaluations curves are interpolated linearly; after its last evaluation a curve is extended with its final
    value. The points are those of the seed with the most evaluations, from the first one that all seeds have reached.
    A seed has NaN where an evaluation has no value; seeds without any value are left out.

    Args:
        curves: for each seed where it was evaluated and the values, ``None`` where there is none; of equal length.
    """
    sides = [(np.array(at, float), np.array(values, float)) for at, values in curves]  # None becomes NaN
    sides = [(at, values) for at, values in sides if np.isfinite(values).any()]
    if not sides:
        return np.empty(0), np.empty((0, 0))
    begun, last = max(at[0] for at, _ in sides), max(at[-1] for at, _ in sides)
    most = max(len(at) for at, _ in sides)
    points = np.unique(np.concatenate([at for at, _ in sides if len(at) == most]))
    points = np.append(points[(points >= begun) & (points < last)], last)
    return points, np.array([np.interp(points, at, values) for at, values in sides])


def band(values: ArrayLike) -> Array:
    """Minimum, median and maximum over the seeds that have a value at each of G points: values (S, G) → (3, G)."""
    table = np.asarray(values, dtype=np.float64)
    result = np.full((3, table.shape[1]), np.nan)
    for i, column in enumerate(table.T):
        known = column[np.isfinite(column)]
        if len(known):
            result[:, i] = known.min(), np.median(known), known.max()
    return result
