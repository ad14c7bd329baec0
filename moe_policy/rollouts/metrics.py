"""Metrics of episodes: fractions, errors, costs relative to a baseline, violations of the path constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Mean, Proportion
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.kinds import AnyFloat

#: Violations, in the unit of the path constraints, up to which an episode counts as clear of them.
TOLERANCES = (0.01, 0.05)


@checked
@dataclass(frozen=True)
class CostRatio:
    """The cost relative to that of a baseline, over the ``episodes`` (a number) in which both enter the goal ball.

    ``ratio`` is Σ cost / Σ cost of the baseline, ``None`` without such episodes.
    """

    ratio: AnyFloat | None
    episodes: int


@checked
@dataclass(frozen=True)
class Violation:
    """The largest violation of the path constraints in an episode, over all episodes.

    Args:
        mean: with its interval.
        quantile_99: exceeded in one episode of a hundred.
        maximum: over all episodes.
    """

    mean: Mean
    quantile_99: AnyFloat
    maximum: AnyFloat

    @classmethod
    def of(cls, values: Array) -> Violation | None:
        """The violation over episodes with ``values`` (B,); NaN, as of a rejected plan's knots, does not count."""
        mean, finite = Mean.of(values), values[np.isfinite(values)]
        return None if mean is None else cls(mean, float(np.quantile(finite, 0.99)), float(finite.max()))


@checked
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
        success_clear: successes whose violation on the whole path is at most a tolerance, by the tolerance in the unit
            of the constraints (:data:`TOLERANCES`); ``None`` without path constraints.
        violation: of the path constraints on the whole path; ``None`` without any.
        knot_violation: the same at the plan's knots; ``None`` without plan or constraints.
    """

    reached: Proportion
    success: Proportion
    success_at_plan_end: Proportion | None
    plan_end_error_median: AnyFloat | None
    plan_end_error_95: AnyFloat | None
    final_error_median: AnyFloat
    final_error_95: AnyFloat
    cost_ratio: CostRatio | None
    left_box: int
    clipped: int
    rejected: int
    success_clear: dict[str, Proportion] | None
    violation: Violation | None
    knot_violation: Violation | None

    @property
    def relative_cost(self) -> float | None:
        """Cost / cost of the baseline; ``None`` without one, or where the two never reach the goal together."""
        return None if self.cost_ratio is None else self.cost_ratio.ratio


@checked
def evaluate(problem: ProblemOrId, episodes: Episodes, baseline: Episodes | None = None) -> Metrics:
    """The metrics of ``episodes`` on ``problem``, with costs relative to those of ``baseline``.

    Raises:
        ValueError: no episodes, or a baseline from other parameters.
    """
    problem = problem_of(problem)
    if len(episodes) == 0:
        raise ValueError("expected at least one episode")
    planned = bool(np.isfinite(episodes.plan_end_error).any())
    constrained = problem.n_clearances > 0
    plan_end_median, plan_end_95 = _quantiles(episodes.plan_end_error) if planned else (None, None)
    final_median, final_95 = _quantiles(episodes.final_error)
    clear = {f"{tolerance:g}": Proportion.of(episodes.success & episodes.clear(tolerance)) for tolerance in TOLERANCES}
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
        success_clear=clear if constrained else None,
        violation=Violation.of(episodes.violation) if constrained else None,
        knot_violation=Violation.of(episodes.knot_violation) if constrained and planned else None,
    )


def _quantiles(errors: Array) -> tuple[float, float]:
    median, high = np.nanquantile(errors, [0.5, 0.95])
    return float(median), float(high)


@checked
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
