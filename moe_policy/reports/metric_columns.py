"""Metrics of episodes as columns, the same in every table; the hardest metric comes first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from moe_policy.reports.tables import Column, proportion
from moe_policy.rollouts.intervals import Proportion, Spread
from moe_policy.rollouts.metrics import TOLERANCES, Metrics, Violation


@dataclass(frozen=True)
class Metric:
    """One metric: its column in tables of single methods, and its value where there is one for each training seed.

    Args:
        key: name in records.
        column: of the metric with its interval.
        value: of the metric alone; ``None`` where the method or the problem has none.
        form: how the value is written.
    """

    key: str
    column: Column[Metrics]
    value: Callable[[Metrics], float | None]
    form: str


def _fraction(key: str, title: str, of: Callable[[Metrics], Proportion | None]) -> Metric:
    def count(metrics: Metrics) -> float | None:
        found = of(metrics)
        return None if found is None else found.count

    return Metric(key, Column(title, of, proportion), count, "g")


def _clear(tolerance: float) -> Metric:
    """At the goal at the evaluation time, and never deeper in a constraint than ``tolerance`` on the whole path."""
    key, title = f"{tolerance:g}", f"at the goal, within {100 * tolerance:g} cm (95 %)"
    return _fraction(f"success_clear_{key}", title, lambda metrics: (metrics.success_clear or {}).get(key))


def _violation(
    key: str, title: str, of: Callable[[Metrics], Violation | None], part: Callable[[Violation], float], form: str
) -> Metric:
    def value(metrics: Metrics) -> float | None:
        found = of(metrics)
        return None if found is None else part(found)

    return Metric(key, Column(title, value, form), value, form)


def _mean_violation(key: str, title: str, of: Callable[[Metrics], Violation | None]) -> Metric:
    found = _violation(key, title, of, lambda violation: violation.mean.mean, ".3f")
    return Metric(key, Column(title, of, _with_interval), found.value, found.form)


def _with_interval(violation: Violation) -> str:
    """For instance ``0.048 (0.046–0.049)``."""
    low, high = violation.mean.interval
    return f"{violation.mean.mean:.3f} ({low:.3f}–{high:.3f})"


def _cost(metrics: Metrics) -> Metrics | None:
    return None if metrics.relative_cost is None else metrics


def _ratio(metrics: Metrics) -> str:
    """The ratio, with the number of episodes behind it where these are not all."""
    found = metrics.cost_ratio
    assert found is not None
    some = "" if found.episodes == metrics.reached.total else f" ({found.episodes:,})"
    return f"{found.ratio:.3f}{some}"


def _path(metrics: Metrics) -> Violation | None:
    return metrics.violation


AT_PLAN_END = _fraction("success_at_plan_end", "success at the plan's end (95 %)", lambda m: m.success_at_plan_end)
SUCCESS = _fraction("success", "… after terminal regulation", lambda m: m.success)
VIOLATION = _mean_violation("violation_mean", "mean violation on the whole path, m (95 %)", _path)
#: The number in brackets says from how many initial conditions both reach the goal, where not from all.
COST = Metric("cost_ratio", Column("cost / optimal", _cost, _ratio), lambda m: m.relative_cost, ".3f")

METRICS: tuple[Metric, ...] = (
    *map(_clear, TOLERANCES),
    AT_PLAN_END,
    SUCCESS,
    VIOLATION,
    _violation("violation_99", "… exceeded by 1 %", _path, lambda violation: violation.quantile_99, ".2f"),
    _violation("violation_max", "… maximum", _path, lambda violation: violation.maximum, ".2f"),
    _mean_violation("knot_violation_mean", "mean violation at the knots, m (95 %)", lambda m: m.knot_violation),
    COST,
)


def spreads_of(found: Sequence[Metrics]) -> dict[str, Spread]:
    """The spreads of the metrics ``found``, one for each training seed, by key: of those that all of them have."""
    values = {metric.key: [metric.value(one) for one in found] for metric in METRICS}
    known = {key: [value for value in each if value is not None] for key, each in values.items()}
    return {key: Spread.of(each) for key, each in known.items() if len(each) == len(found)}
