"""The figure of success against training size."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.experiments.figures.style import COLORS, save_figure
from moe_policy.experiments.records import Absent, present
from moe_policy.experiments.seeds import TrainingRow
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Values = Callable[[TrainingRow], tuple[float | None, ...] | Absent]
_AT_KNOTS: Mapping[str, Values] = {
    "at the knots": lambda row: row.knot_violation,
    "on the whole path": lambda row: row.violation,
}
_SUCCESS: Mapping[str, Values] = {
    "after the hold": lambda row: row.success,
    "at the plan's end": lambda row: row.success_at_plan_end,
}


def sizes_figure(path: str | os.PathLike[str], rows: Sequence[TrainingRow], cases: int) -> Path:
    """Failures of ``cases`` instances against the number of training instances: the median over seeds, and the range.

    With path constraints, mean violations in metres instead. On logarithmic scales, where no failure is drawn as half a
    failure.
    """
    constrained = any(present(row.violation_spread) for row in rows)
    shown = dict(_AT_KNOTS if constrained else _SUCCESS)
    if not constrained and all(row.success == row.success_at_plan_end for row in rows):
        del shown["after the hold"]  # the goal cannot be regulated

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
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
    for color, name in zip(COLORS, dict.fromkeys(row.name for row in rows)):
        chosen = sorted((row for row in rows if row.name == name), key=lambda row: row.samples)
        counts = [row.samples for row in chosen]
        low, median, high = np.array([np.quantile(wrong(row), [0, 0.5, 1]) for row in chosen]).T
        axes.fill_between(counts, low, high, color=color, alpha=0.2, linewidth=0)
        axes.plot(counts, median, "o-", color=color, label=name, markersize=4)
