"""Metrics of episodes: fractions, errors, costs relative to a baseline, violations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array


@dataclass(frozen=True)
class CostRatio:
    """The cost relative to that of a baseline, over the ``episodes`` (a number) in which both enter the goal ball.

    ``ratio`` is Σ cost / Σ cost of the baseline, ``None`` without such episodes.
    """

    ratio: float | None
    episodes: int


@dataclass(frozen=True)
class Metrics:
    """Metrics of one policy; the names are the keys in records.

    Args:
        reached: entered the goal ball.
        success: in the goal ball at the evaluation time.
        success_at_plan_end: in the goal ball at the plan's end, before terminal regulation; ``None`` without a plan.
        plan_end_error_median, plan_end_error_95: quantiles of the error at the plan's end; ``None`` without a plan.
        final_error_median, final_error_95: quantiles of the error at the evaluation time.
        cost_ratio: against a baseline, usually the tracked optimal plans; ``None`` without one.
        left_box: episodes that left the operating box.
        clipped: plans whose duration was clipped.
        rejected: plans that were not finite.
        violation_mean, violation_max: largest violation of the path constraints on the path; ``None`` without any.
        knot_violation_mean, knot_violation_max: the same at the plan's knots; ``None`` without plan or constraints.
    """

    reached: Proportion
    success: Proportion
    success_at_plan_end: Proportion | None
    plan_end_error_median: float | None
    plan_end_error_95: float | None
    final_error_median: float
    final_error_95: float
    cost_ratio: CostRatio | None
    left_box: int
    clipped: int
    rejected: int
    violation_mean: float | None
    violation_max: float | None
    knot_violation_mean: float | None
    knot_violation_max: float | None

    @property
    def relative_cost(self) -> float | None:
        """Cost / cost of the baseline; ``None`` without one, or where the two never reach the goal together."""
        return None if self.cost_ratio is None else self.cost_ratio.ratio


def evaluate(problem: OptimalControlProblem, episodes: Episodes, baseline: Episodes | None = None) -> Metrics:
    """The metrics of ``episodes`` on ``problem``, with costs relative to those of ``baseline``.

    Raises:
        ValueError: no episodes, or a baseline from other parameters.
    """
    if len(episodes) == 0:
        raise ValueError("expected at least one episode")
    planned = bool(np.isfinite(episodes.plan_end_error).any())
    constrained = problem.n_clearances > 0
    plan_end_median, plan_end_95 = _quantiles(episodes.plan_end_error) if planned else (None, None)
    final_median, final_95 = _quantiles(episodes.final_error)
    path_mean, path_max = _mean_and_max(episodes.violation) if constrained else (None, None)
    knot_mean, knot_max = _mean_and_max(episodes.knot_violation) if constrained and planned else (None, None)
    return Metrics(
        reached=Proportion.of(episodes.reached),
        success=Proportion.of(episodes.success),
        success_at_plan_end=Proportion.of(episodes.plan_end_error < problem.goal.radius) if planned else None,
        plan_end_error_median=plan_end_median,
        plan_end_error_95=plan_end_95,
        final_error_median=final_median,
        final_error_95=final_95,
        cost_ratio=None if baseline is None else cost_ratio(episodes, baseline),
        left_box=int(episodes.left_box.sum()),
        clipped=int(episodes.clipped.sum()),
        rejected=int(episodes.rejected.sum()),
        violation_mean=path_mean,
        violation_max=path_max,
        knot_violation_mean=knot_mean,
        knot_violation_max=knot_max,
    )


def _quantiles(errors: Array) -> tuple[float, float]:
    median, high = np.nanquantile(errors, [0.5, 0.95])
    return float(median), float(high)


def _mean_and_max(violation: Array) -> tuple[float | None, float | None]:
    """Over the episodes that have a value: a rejected plan has no knots."""
    values = violation[np.isfinite(violation)]
    return (float(values.mean()), float(values.max())) if len(values) else (None, None)


def cost_ratio(episodes: Episodes, baseline: Episodes) -> CostRatio:
    """The cost of ``episodes`` relative to that of ``baseline``, over those in which both enter the goal ball.

    Raises:
        ValueError: the two ran from different parameters.
    """
    if not np.array_equal(episodes.parameters, baseline.parameters):
        raise ValueError("costs can only be compared with those of a baseline from the same parameters, in order")
    both = episodes.reached & baseline.reached
    total = float(baseline.cost[both].sum())
    ratio = float(episodes.cost[both].sum()) / total if total > 0 else None
    return CostRatio(ratio, int(both.sum()))
