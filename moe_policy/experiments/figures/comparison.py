"""The figure of a comparison: successes with their intervals, and the errors at the ends of the plans."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from moe_policy.experiments.figures.style import looks, save_figure
from moe_policy.rollouts.metrics import Metrics
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_success(axes: Axes, metrics: Mapping[str, Metrics]) -> None:
    """Successes with their 95 % intervals; filled marks after terminal regulation, open ones at the plan's end."""
    styles = looks(metrics)
    for i, (name, found) in enumerate(metrics.items()):
        color = styles[name]["color"]
        for value, shift, face in ((found.success, -0.12, color), (found.success_at_plan_end, 0.12, "white")):
            if value is None:
                continue
            low, high = value.interval
            axes.plot([100 * low, 100 * high], [i + shift] * 2, color=color)
            axes.plot(100 * value.fraction, i + shift, "o", color=color, markerfacecolor=face, markersize=5)
    axes.set_yticks(range(len(metrics)), [*metrics])
    axes.set_ylim(len(metrics) - 0.5, -0.5)
    axes.set_xlabel("success, %, with 95 % interval")
    axes.set_title("filled: after the hold, open: at the plan's end")


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
    axes.set_title("before any hold")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def comparison_figure(
    path: str | os.PathLike[str], metrics: Mapping[str, Metrics], errors: Mapping[str, Array], radius: float
) -> Path:
    """Successes of all methods next to the distributions of their errors ‖x − goal‖ at the plan's end, each (B,)."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        draw_success(left, metrics)
        draw_errors(right, errors, radius)

    return save_figure(path, (10.0, 1.6 + 0.35 * len(metrics)), draw)
