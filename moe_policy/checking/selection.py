"""The best of several plans for an instance, by what the model predicts of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from moe_policy.checking.forecast import Forecast, Predicted
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: How far from success a plan counts that leaves the operating box.
_LEFT_BOX = 1e6


@dataclass(frozen=True, eq=False)
class Selected(Batch):
    """For each of B instances a ``plan`` and what is ``predicted`` of it; how the plan was made and from which source.

    ``how`` and ``source`` (B,) are indices.
    """

    plan: Trajectory
    predicted: Predicted
    how: Ints
    source: Ints

    def improved(self, rows: Ints, new: Selected, radius: float) -> Selected:
        """This selection with those of ``rows`` (M,) replaced for which ``new``, M of them, has a better plan.

        The goal has the ``radius``.
        """
        old = self[rows]
        wins = better(new.predicted, old.predicted, radius)
        return self.replaced_at(rows[wins], new[np.flatnonzero(wins)])


def deficit(predicted: Predicted, radius: float) -> Array:
    """How far the plans of ``predicted`` are from success, (B,).

    This is the error beyond the ``radius`` of the goal, in radii, and the depth in a constraint.
    """
    beyond = np.maximum(predicted.final_error / radius - 1, 0.0) + np.maximum(-predicted.clearance, 0.0)
    far = np.where(predicted.left_box, _LEFT_BOX + beyond, beyond)
    return np.where(predicted.rejected | np.isnan(far), np.inf, far)


def better(one: Predicted, other: Predicted, radius: float) -> Bools:
    """Whether each plan of ``one`` is better than that of ``other``: cheaper, where both succeed.

    The goal has the ``radius``.
    """
    both = one.success & other.success
    nearer = deficit(one, radius) < deficit(other, radius)
    return np.where(both, one.cost < other.cost, one.success | (~other.success & nearer))


def cheapest(predicted: Predicted, row: Ints, radius: float) -> Ints:
    """Of M plans for the instances ``row`` (M,), the best for each instance that occurs, in order of the instances.

    Forecasts of the plans are ``predicted``.
    The best is the cheapest that succeeds, else the one nearest to success; of equal ones it is the first. The goal has
    the ``radius``.
    """
    measure = np.where(predicted.success, predicted.cost, deficit(predicted, radius))
    order = np.lexsort((measure, ~predicted.success, row))
    _, first = np.unique(row[order], return_index=True)
    return np.asarray(order[first])


def select(forecast: Forecast, parameters: Array, plans: Sequence[Trajectory], how: int, sources: Ints) -> Selected:
    """The best of several ``plans`` for each instance, all of them forecast in one batch.

    The instances have ``parameters`` (B, np). The plans are at least one batch of B, made in the way ``how`` (an index)
    from the ``sources`` (B, number of batches).
    """
    size, count = len(parameters), len(plans)
    predicted = forecast(np.tile(parameters, (count, 1)), Trajectory.concatenate(plans))
    best = cheapest(predicted, np.tile(np.arange(size), count), forecast.problem.goal.radius)
    return Selected(
        plan=Trajectory.concatenate(plans)[best],
        predicted=predicted[best],
        how=np.full(size, how),
        source=sources.T.reshape(-1)[best],
    )
