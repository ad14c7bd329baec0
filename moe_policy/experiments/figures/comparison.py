"""Figures of metrics of methods: side by side, against the training size, and along margins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from moe_policy.experiments.comparison import MarginRow
from moe_policy.experiments.figures.style import Axes, Figure, Panels, looks, save_figure
from moe_policy.experiments.seeds import TrainingRow
from moe_policy.reports.records import Absent, present
from moe_policy.rollouts.metrics import Metrics
from ocp_envs.support.arrays import Array

Values = Callable[[TrainingRow], tuple[float | None, ...] | Absent]
_AT_KNOTS: Mapping[str, Values] = {
    "at the knots": lambda row: row.knot_violation,
    "on the whole path": lambda row: row.violation,
}
_SUCCESS: Mapping[str, Values] = {
    "at the plan's end": lambda row: row.success_at_plan_end,
    "after terminal regulation": lambda row: row.success,
}


def draw_success(axes: Axes, metrics: Mapping[str, Metrics]) -> None:
    """Successes with their 95 % intervals; filled marks at the plan's end, open ones after terminal regulation."""
    styles = looks(metrics)
    for i, (name, found) in enumerate(metrics.items()):
        color = styles[name]["color"]
        for value, shift, face in ((found.success_at_plan_end, -0.12, color), (found.success, 0.12, "white")):
            if value is None:
                continue
            low, high = value.interval
            axes.plot([100 * low, 100 * high], [i + shift] * 2, color=color)
            axes.plot(100 * value.fraction, i + shift, "o", color=color, markerfacecolor=face, markersize=5)
    axes.set_yticks(range(len(metrics)), [*metrics])
    axes.set_ylim(len(metrics) - 0.5, -0.5)
    axes.set_xlabel("success, %, with 95 % interval")
    axes.set_title("filled: at the plan's end, open: after terminal regulation")


def draw_errors(axes: Axes, errors: Mapping[str, Array], radius: float) -> None:
    """Distributions of the errors at the plan's end (NaN: no plan); dashed: the ``radius`` of the goal ball."""
    styles = looks(errors)
    for name, values in errors.items():
        found = np.sort(values[np.isfinite(values)])
        if len(found):
            percent = 100 * np.arange(1, len(found) + 1) / len(found)
            axes.step(np.maximum(found, 1e-9), percent, where="post", label=name, **styles[name])
    axes.axvline(radius, color="black", linestyle="--", linewidth=0.8, label="goal ball")
    axes.set_xscale("log")
    axes.set_ylim(0, 101)
    axes.set_xlabel("state error at the plan's end")
    axes.set_ylabel("episodes below, %")
    axes.set_title("before terminal regulation")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def comparison_figure(
    path: str | Path, metrics: Mapping[str, Metrics], errors: Mapping[str, Array], radius: float
) -> Path:
    """Successes of all methods next to the distributions of their errors ‖x − goal‖ at the plan's end, each (B,)."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        draw_success(left, metrics)
        draw_errors(right, errors, radius)

    return save_figure(path, (10.0, 1.6 + 0.35 * len(metrics)), draw)


def sizes_figure(path: str | Path, rows: Sequence[TrainingRow], cases: int) -> Path:
    """Failures of ``cases`` instances against the number of training instances: the median over seeds, and the range.

    With path constraints, mean violations in metres instead. On logarithmic scales, where no failure is drawn as half a
    failure.
    """
    constrained = any(present(row.violation_spread) for row in rows)
    shown = dict(_AT_KNOTS if constrained else _SUCCESS)
    if not constrained and all(row.success == row.success_at_plan_end for row in rows):
        del shown["after terminal regulation"]  # the goal cannot be regulated

    def draw(figure: Figure) -> None:
        panels: Panels = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
        for ax, (title, of) in zip(panels, shown.items()):
            _panel(ax, rows, partial(_wrong, of, None if constrained else cases))
            ax.set(xscale="log", yscale="log", xlabel="training problems", title=title)
            if constrained:  # less than a decade: each tick shows its number
                ax.yaxis.set_major_formatter("{x:g}")
                ax.yaxis.set_minor_formatter("{x:g}")
        panels[0].set_ylabel("mean violation, m" if constrained else f"failures of {cases:,}")
        panels[0].legend()

    return save_figure(path, (8.0 if len(shown) == 2 else 4.5, 3.2), draw)


def _wrong(of: Values, cases: int | None, row: TrainingRow) -> Array:
    """Violations of each seed, or with a number of ``cases`` the failures among them, at least one half."""
    found = np.array(present(of(row)) or (), dtype=np.float64)
    return found if cases is None else np.maximum(cases - found, 0.5)


def _panel(axes: Axes, rows: Sequence[TrainingRow], wrong: Callable[[TrainingRow], Array]) -> None:
    """A curve and its band for each model."""
    for name, look in looks(row.name for row in rows).items():
        color = look["color"]
        chosen = sorted((row for row in rows if row.name == name), key=lambda row: row.samples)
        counts = [row.samples for row in chosen]
        low, median, high = np.array([np.quantile(wrong(row), [0, 0.5, 1]) for row in chosen]).T
        axes.fill_between(counts, low, high, color=color, alpha=0.2, linewidth=0)
        axes.plot(counts, median, "o-", color=color, label=name, markersize=4)


def margins_figure(path: str | Path, rows: Sequence[MarginRow]) -> Path:
    """Mean violation on the whole path against cost: a curve over margins for each planner, a star for the optimum."""
    curves: dict[str, list[MarginRow]] = {}
    for row in rows:
        curves.setdefault(row.row.name, []).append(row)

    def draw(figure: Figure) -> None:
        axes, styles = figure.subplots(), looks(curves)
        for i, (name, curve) in enumerate(curves.items()):
            optimum = curve[0].margin is None
            metrics = [row.row.metrics for row in curve]
            cost = [100 * ((m.relative_cost or np.nan) - 1) for m in metrics]
            violation = [np.nan if m.violation is None else m.violation.mean.mean for m in metrics]
            form, color, size = ("*" if optimum else "o-", styles[name]["color"], 9 if optimum else 4)
            axes.plot(cost, violation, form, color=color, label=name, markersize=size)
            for row, x, y in zip(curve, cost, violation):
                if row.margin is not None:
                    text = f"{row.margin:g}"
                    first = i <= 1  # after the optimum; curves may be close to each other
                    beside, side = ((3, 3), "left") if first else ((-3, -8), "right")
                    axes.annotate(
                        text, (x, y), xytext=beside, textcoords="offset points", fontsize=7, color=color, ha=side
                    )
        axes.set(xlabel="cost above the tracked optimum, %", ylabel="mean violation on the whole path, m")
        axes.set_ylim(bottom=0.0)
        axes.set_title("margins on the radius, m")
        axes.legend()

    return save_figure(path, (5.6, 3.8), draw)
