"""Success, cost and return against environment steps and wall time, from a record of budgets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.experiments.budgets import Budgets
from moe_policy.experiments.figures.style import Axes, Figure, Panels, looks, save_figure
from moe_policy.experiments.learner_budgets import (
    ChosenActor,
    Curve,
    DevelopmentMetrics,
    LearnerBudget,
    band,
    over_seeds,
)
from moe_policy.experiments.planner_budgets import PlannerBudget, PlannerRow
from moe_policy.rollouts.intervals import Spread

_MARKERS = "sDv^Po"


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A row of the figure."""

    title: str  # of the axis
    of: Callable[[DevelopmentMetrics], float | None]  # its value in metrics on the development set
    along: Callable[[Curve], Sequence[float | None]]  # its values along a training curve
    #: of a planner, on the validation set; ``None`` for a metric that is not measured there
    over_seeds: Callable[[PlannerRow], Spread | None] | None = None
    factor: float = 1.0  # from its unit in the record to that of the axis
    scale: Callable[[Axes], object] = lambda axes: None  # sets the limits or the scale of the axis


@dataclass(frozen=True, kw_only=True)
class Budget:
    """A column of the figure."""

    title: str  # of the axis
    along: Callable[[Curve], Sequence[float]]  # of the evaluations of a training curve
    of_actor: Callable[[ChosenActor], float | None]  # of the shipped actor of a learner; ``None`` where it is not known
    #: from the lower to the higher count; ``None`` where it is not known
    of_planner: Callable[[PlannerBudget], tuple[float, float] | None]


def _logarithmic_if_wide(axes: Axes) -> None:
    """Negative returns that range over more than a decade are drawn on a logarithmic axis."""
    best, worst = -axes.dataLim.y1, -axes.dataLim.y0
    if worst > 10 * best > 0:
        axes.set_yscale("symlog", linthresh=best, subs=(2, 5))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")


#: A row without any value is left out.
METRICS = (
    Metric(
        title="success, %",
        of=lambda metrics: metrics.success,
        along=lambda curve: curve.success,
        over_seeds=lambda row: row.validation_success,
        factor=100.0,
        scale=lambda axes: axes.set_ylim(-3, 103),
    ),
    Metric(
        title="cost / tracked optimum\n(successes)",
        of=lambda metrics: metrics.cost_ratio,
        along=lambda curve: curve.cost_ratio,
    ),
    Metric(
        title="mean return",
        of=lambda metrics: metrics.mean_return,
        along=lambda curve: curve.mean_return,
        scale=_logarithmic_if_wide,
    ),
    Metric(
        title="mean violation, m",
        of=lambda metrics: metrics.violation,
        along=lambda curve: curve.violation,
        over_seeds=lambda row: row.validation_violation,
    ),
)
BUDGETS = (
    Budget(
        title="environment steps; states simulated by the solver (open: of its solutions)",
        along=lambda curve: curve.steps,
        of_actor=lambda actor: actor.steps,
        of_planner=lambda budget: (budget.states_of_solutions, budget.states_of_iterations),
    ),
    Budget(
        title="wall time, s",
        along=lambda curve: curve.seconds,
        of_actor=lambda actor: actor.seconds,
        of_planner=lambda budget: None if budget.seconds is None else (budget.seconds, budget.seconds),
    ),
)


def budgets_figure(path: str | Path, record: Budgets) -> Path:
    """One row for each of :data:`METRICS`, one column for each of :data:`BUDGETS`.

    Learners are lines: thin lines for the seeds, a thick one for their median, a band from the minimum to the maximum,
    and a ring for the shipped actor. Planners are markers, filled at the simulated states of the solver's iterations,
    open at those of its solutions, and lines where they were trained on several numbers of instances; bars range from
    the minimum to the maximum seed. A planner without a record of its data is a horizontal line. Success and violation
    of planners are over seeds on the validation set; everything else is on the development set.
    """
    record = record.relative()
    shown = [metric for metric in METRICS if _has(record, metric)]
    styles = _styles(record)

    def draw(figure: Figure) -> None:
        panels: Panels = figure.subplots(len(shown), len(BUDGETS), sharex="col", sharey="row", squeeze=False)
        for row, metric in zip(panels, shown):
            for axes, budget in zip(row, BUDGETS):
                _draw_panel(axes, record, styles, metric, budget)
            row[0].set_ylabel(metric.title)
            row[0].autoscale(axis="y")  # horizontal lines alone do not
            metric.scale(row[0])
        figure.suptitle(f"{record.env_id}: learners (lines, thick: median of seeds) and planners (marks)", fontsize=10)
        for axes, budget in zip(panels[-1], BUDGETS):
            axes.set_xlabel(budget.title)
        handles = {text: handle for axes in panels.ravel() for handle, text in zip(*axes.get_legend_handles_labels())}
        figure.legend(handles.values(), handles.keys(), loc="outside right upper", fontsize=8)

    return save_figure(path, (10.0, 0.9 + 2.2 * len(shown)), draw)


def _has(record: Budgets, metric: Metric) -> bool:
    """Whether any method has a value of ``metric``."""
    learners = record.learners.values()
    values = [value for learner in learners for curve in learner.curves for value in metric.along(curve)]
    others = [row.development for row in record.shipped] + [level.development for level in record.levels]
    others += [learner.chosen.development for learner in learners if learner.chosen is not None]
    return any(value is not None for value in (*values, *map(metric.of, others)))


def _planners(record: Budgets) -> list[str]:
    return list(dict.fromkeys([row.name for row in record.planners] + [row.name for row in record.shipped]))


def _styles(record: Budgets) -> dict[str, tuple[str, str]]:
    """Colour and marker of every method."""
    found = looks(["optimal", "nearest", *_planners(record), *record.learners])  # the colours of the comparison
    return {name: (look["color"], _MARKERS[i % len(_MARKERS)]) for i, (name, look) in enumerate(found.items())}


def _draw_panel(
    axes: Axes, record: Budgets, styles: Mapping[str, tuple[str, str]], metric: Metric, budget: Budget
) -> None:
    for name, learner in record.learners.items():
        _draw_learner(axes, name, learner, styles[name][0], metric, budget)
    for level in record.levels:
        value = metric.of(level.development)
        if value is not None:
            axes.axhline(metric.factor * value, color="black", linestyle=":", linewidth=1.0, label=level.name)
    for name in _planners(record):
        _draw_planner(axes, name, _rows(record, name, metric), styles[name], metric, budget)
    axes.set_xscale("log")
    axes.xaxis.set_minor_formatter("")


def _draw_learner(axes: Axes, name: str, learner: LearnerBudget, color: str, metric: Metric, budget: Budget) -> None:
    for curve in learner.curves:
        values = metric.factor * np.array(metric.along(curve), float)
        axes.plot(budget.along(curve), values, color=color, linewidth=0.6, alpha=0.6)
    points, values = over_seeds((budget.along(curve), metric.along(curve)) for curve in learner.curves)
    if len(points):
        low, median, high = metric.factor * band(values)
        axes.fill_between(points, low, high, color=color, alpha=0.15, linewidth=0)
        axes.plot(points, median, color=color)
    n = len(learner.seeds)
    axes.plot([], [], color=color, label=f"{name}, {n} seed{'s' if n > 1 else ''}")
    if learner.chosen is None:
        return
    spent, reached = budget.of_actor(learner.chosen), metric.of(learner.chosen.development)
    if spent is not None and reached is not None:
        axes.plot(spent, metric.factor * reached, "o", color=color, markerfacecolor="none", markersize=8)


def _rows(record: Budgets, name: str, metric: Metric) -> list[tuple[PlannerBudget | None, Spread]]:
    """Budgets and values of the planner ``name``: over seeds where they are measured so, else of the shipped one."""
    seeds = [row for row in record.planners if row.name == name]
    if metric.over_seeds is not None and seeds:
        found = [(row.budget, metric.over_seeds(row)) for row in seeds]
    else:
        values = [(row.budget, metric.of(row.development)) for row in record.shipped if row.name == name]
        found = [(budget, None if value is None else Spread.of([value])) for budget, value in values]
    return [(budget, spread) for budget, spread in found if spread is not None]


def _draw_planner(
    axes: Axes,
    name: str,
    rows: Sequence[tuple[PlannerBudget | None, Spread]],
    style: tuple[str, str],
    metric: Metric,
    budget: Budget,
) -> None:
    color, marker = style
    spent = [(budget.of_planner(known), spread) for known, spread in rows if known is not None]
    placed = [(counts, spread) for counts, spread in spent if counts is not None]
    if not placed:
        for _, spread in rows[-1:]:
            axes.axhline(metric.factor * spread.median, color=color, linestyle="-.", linewidth=1.0, label=name)
        return
    at = np.array([counts for counts, _ in placed])
    values = metric.factor * np.array([[spread.minimum, spread.median, spread.maximum] for _, spread in placed])
    for (few, many), (low, median, high) in zip(at, values):
        axes.plot([few, many], [median, median], color=color, linewidth=0.6, alpha=0.4)
        axes.plot([many, many], [low, high], color=color, linewidth=1.2)
    axes.plot(at[:, 0], values[:, 1], marker, color=color, markerfacecolor="white", markersize=5)
    axes.plot(at[:, 1], values[:, 1], marker, color=color, linestyle="--", linewidth=0.8, markersize=5, label=name)
