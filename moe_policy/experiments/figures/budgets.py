"""Success, cost and return against what was spent: environment steps, and wall time.

Drawn from the record of scripts/compare_budgets.py alone. What its figures mean is said in
:mod:`moe_policy.experiments.budgets` and :mod:`moe_policy.experiments.curves`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.experiments.curves import band, over_seeds
from moe_policy.experiments.figures.style import looks, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Record = Mapping[str, Any]

#: Titles of the rows; a row without anything to show is left out.
ROWS = {
    "success": "success, %",
    "cost_ratio": "cost / optimal cost\n(successes)",
    "mean_return": "mean return",
    "violation": "mean violation, m",
}
AXES = {
    "steps": "environment steps; states simulated by the solver (open: of its solutions)",
    "seconds": "wall time, s",
}
#: The abscissae of a planner's budget on each axis: from the friendlier count to the honest one.
SPENT = {"steps": ("states_of_solutions", "states_of_iterations"), "seconds": ("seconds", "seconds")}
_MARKERS = "sDv^Po"


def budgets_figure(path: str | os.PathLike[str], record: Record) -> Path:
    """One row for each figure of :data:`ROWS`, one column for steps and one for wall time.

    Learners are lines: thin ones the seeds, the thick one their median, the band from the least to the most; a ring is
    the chosen actor that is shipped. Planners are marks, filled at the simulated states of the solver's iterations
    (open: of its solutions alone), and lines where they were trained on several numbers of problems, with bars from
    the least to the most seed; without a record of their data, levels. Their success and violation are over seeds on
    the validation set, all else is from the development set.

    Args:
        path: file to write.
        record: of scripts/compare_budgets.py.
    """
    shown = [key for key in ROWS if _has(record, key)]
    styles = _styles(record)

    def draw(figure: Figure) -> None:
        panels: Any = figure.subplots(len(shown), len(AXES), sharex="col", sharey="row", squeeze=False)
        for row, key in zip(panels, shown):
            for axes, axis in zip(row, AXES):
                _draw_learners(axes, record["learners"], styles, axis, key)
                _draw_planners(axes, record, styles, axis, key)
                axes.set_xscale("log")
                axes.xaxis.set_minor_formatter("")
            row[0].set_ylabel(ROWS[key])
            _scale(row[0], key)
        figure.suptitle(
            f"{record['env_id']}: learners (lines, thick: median of seeds) and planners (marks)", fontsize=10
        )
        for axes, label in zip(panels[-1], AXES.values()):
            axes.set_xlabel(label)
        handles = {text: handle for axes in panels.flat for handle, text in zip(*axes.get_legend_handles_labels())}
        figure.legend(handles.values(), handles.keys(), loc="outside right upper", fontsize=8)

    return save_figure(path, (10.0, 0.9 + 2.2 * len(shown)), draw)


def _has(record: Record, key: str) -> bool:
    """Whether there is anything to show in the row ``key``."""
    curves = (value for run in record["learners"].values() for curve in run["curves"] for value in curve[key])
    chosen = (run["chosen"] for run in record["learners"].values() if run["chosen"])
    others = (row["development"][key] for row in (*record["shipped"], *record["levels"], *chosen))
    return any(value is not None for value in (*curves, *others))


def _styles(record: Record) -> dict[str, tuple[str, str]]:
    """Colour and marker of everybody."""
    planners = dict.fromkeys(row["name"] for row in (*record["planners"], *record["shipped"]))
    found = looks(["optimal", "nearest", *planners, *record["learners"]])  # the colours of the comparison
    return {name: (look["color"], _MARKERS[i % len(_MARKERS)]) for i, (name, look) in enumerate(found.items())}


def _factor(key: str) -> float:
    return 100.0 if key == "success" else 1.0


def _draw_learners(axes: Axes, learners: Record, styles: Mapping[str, Any], axis: str, key: str) -> None:
    for name, run in learners.items():
        color, n = styles[name][0], len(run["seeds"])
        for curve in run["curves"]:
            values = _factor(key) * np.array(curve[key], float)
            axes.plot(curve[axis], values, color=color, linewidth=0.6, alpha=0.6)
        points, values = over_seeds(run["curves"], axis, key)
        if len(points):
            least, median, most = _factor(key) * band(values)
            axes.fill_between(points, least, most, color=color, alpha=0.15, linewidth=0)
            axes.plot(points, median, color=color)
        axes.plot([], [], color=color, label=f"{name}, {n} seed{'s' if n > 1 else ''}")
        chosen = run["chosen"]
        if chosen and chosen[axis] is not None and chosen["development"][key] is not None:
            value = _factor(key) * chosen["development"][key]
            axes.plot(chosen[axis], value, "o", color=color, markerfacecolor="none", markersize=8)


def _draw_planners(axes: Axes, record: Record, styles: Mapping[str, Any], axis: str, key: str) -> None:
    """Planners and what is always the same."""
    for row in record["levels"]:
        value = row["development"][key]
        if value is not None:
            axes.axhline(_factor(key) * value, color="black", linestyle=":", linewidth=1.0, label=row["name"])
    over = {"success": "validation_success", "violation": "validation_violation"}.get(key)
    for name in dict.fromkeys(row["name"] for row in (*record["planners"], *record["shipped"])):
        if over is not None and any(row["name"] == name for row in record["planners"]):
            rows = [(row, row[over]) for row in record["planners"] if row["name"] == name]
        else:
            rows = [(row, _single(row["development"][key])) for row in record["shipped"] if row["name"] == name]
        _draw_planner(axes, name, [row for row in rows if row[1] is not None], styles[name], axis, _factor(key))


def _single(value: float | None) -> dict[str, float] | None:
    return None if value is None else {"median": value, "least": value, "most": value}


def _draw_planner(
    axes: Axes, name: str, rows: Sequence[tuple[Record, Any]], style: tuple[str, str], axis: str, factor: float
) -> None:
    """One planner: ``rows`` are pairs of a record with its budget and the figure's median, least and most."""
    color, marker = style
    placed = [(row["budget"], figure) for row, figure in rows if row["budget"] and row["budget"][SPENT[axis][0]]]
    if not placed:
        for _, figure in rows[-1:]:
            axes.axhline(factor * figure["median"], color=color, linestyle="-.", linewidth=1.0, label=name)
        return
    at = np.array([[budget[key] for key in SPENT[axis]] for budget, _ in placed])
    values = factor * np.array([[figure[key] for key in ("least", "median", "most")] for _, figure in placed])
    for (few, many), (least, median, most) in zip(at, values):
        axes.plot([few, many], [median, median], color=color, linewidth=0.6, alpha=0.4)
        axes.plot([many, many], [least, most], color=color, linewidth=1.2)
    axes.plot(at[:, 0], values[:, 1], marker, color=color, markerfacecolor="white", markersize=5)
    axes.plot(at[:, 1], values[:, 1], marker, color=color, linestyle="--", linewidth=0.8, markersize=5, label=name)


def _scale(axes: Axes, key: str) -> None:
    """Shares are read off straight, and so are returns unless they are spread over decades (they are negative)."""
    axes.autoscale(axis="y")  # levels alone do not
    if key == "success":
        axes.set_ylim(-3, 103)
    elif key == "mean_return":
        best, worst = -axes.dataLim.y1, -axes.dataLim.y0
        if worst > 10 * best > 0:
            axes.set_yscale("symlog", linthresh=best, subs=(2, 5))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
