"""The figure of a comparison: successes with their intervals, and errors at the ends of the plans."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from moe_policy.experiments.figures.style import looks, save_figure
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Outcome:
    """One policy in the comparison figure.

    Args:
        name: label.
        success: at the judging time.
        success_at_plan_end: before any hold; ``None`` without a plan.
        errors: ‖x − goal‖ at the plan's end, (B,); ``None`` without a plan.
    """

    name: str
    success: Proportion
    success_at_plan_end: Proportion | None = None
    errors: Array | None = None


def draw_success(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    """Fraction of successes of each policy with its 95 % interval; open marks: at the plan's end, without the hold."""
    styles = looks(outcome.name for outcome in outcomes)
    for i, outcome in enumerate(outcomes):
        color = styles[outcome.name]["color"]
        marks = ((outcome.success, -0.12, color), (outcome.success_at_plan_end, 0.12, "white"))
        for value, shift, face in marks:
            if value is None:
                continue
            low, high = value.interval
            axes.plot([100 * low, 100 * high], [i + shift] * 2, color=color)
            axes.plot(100 * value.fraction, i + shift, "o", color=color, markerfacecolor=face, markersize=5)
    axes.set_yticks(range(len(outcomes)), [outcome.name for outcome in outcomes])
    axes.set_ylim(len(outcomes) - 0.5, -0.5)
    axes.set_xlabel("success, %, with 95 % interval")
    axes.set_title("filled: after the hold, open: at the plan's end")


def draw_errors(axes: Axes, outcomes: Sequence[Outcome], radius: float) -> None:
    """Distribution of the error at the plan's end; the dashed line is the goal's ``radius``."""
    styles = looks(outcome.name for outcome in outcomes)
    for outcome in outcomes:
        if outcome.errors is None:
            continue
        errors = np.sort(outcome.errors[np.isfinite(outcome.errors)])
        if len(errors):
            percent = 100 * np.arange(1, len(errors) + 1) / len(errors)
            axes.step(np.maximum(errors, 1e-9), percent, where="post", label=outcome.name, **styles[outcome.name])
    axes.axvline(radius, color="black", linestyle="--", linewidth=0.8, label="goal ball")
    axes.set_xscale("log")
    axes.set_ylim(0, 101)
    axes.set_xlabel("state error at the plan's end")
    axes.set_ylabel("episodes below, %")
    axes.set_title("before any hold")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def comparison_figure(path: str | os.PathLike[str], outcomes: Sequence[Outcome], radius: float) -> Path:
    """Success of all policies beside the distribution of their errors at the plan's end, saved as PNG."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        draw_success(left, outcomes)
        draw_errors(right, outcomes, radius)

    return save_figure(path, (10.0, 1.6 + 0.35 * len(outcomes)), draw)
