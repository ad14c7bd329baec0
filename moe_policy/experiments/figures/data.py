"""A figure of what the databases of a problem hold, one colour for each split."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from moe_policy.experiments.data import Contents
from moe_policy.experiments.data_report import CLOSE
from moe_policy.experiments.figures.style import COLORS, Axes, Figure, save_figure
from ocp_envs.solvers.accuracy import Accuracy
from ocp_envs.support.arrays import Array

_BINS_PER_DECADE = 5
#: By split, what its database holds and the accuracy of its plans.
Reports = Mapping[str, tuple[Contents, Accuracy | None]]


def data_figure(path: str | Path, reports: Reports) -> Path:
    """Fractions of the solution families, families found, cost differences and accuracy, one colour for each split."""

    def draw(figure: Figure) -> None:
        (classes, modes), (differences, errors) = figure.subplots(2, 2)
        _draw_classes(classes, reports)
        _draw_modes(modes, reports)
        _draw_differences(differences, reports)
        _draw_accuracy(errors, reports)
        figure.legend(*classes.get_legend_handles_labels(), loc="outside lower center", ncols=len(reports))

    return save_figure(path, (10.0, 7.0), draw)


def _offsets(count: int) -> tuple[Array, float]:
    """Positions of ``count`` bars relative to their tick, and their width."""
    width = 0.8 / count
    return np.asarray((np.arange(count) - (count - 1) / 2) * width, dtype=np.float64), width


def _draw_classes(axes: Axes, reports: Reports) -> None:
    shifts, width = _offsets(len(reports))
    for i, (name, (held, _)) in enumerate(reports.items()):
        families = held.report.families
        places = np.arange(len(families)) + shifts[i]
        label = f"{name}: {held.report.totals.solved:,} solved instances"
        axes.barh(places, [100 * family.share for family in families], width, color=COLORS[i], label=label)
        axes.set_yticks(range(len(families)), [family.mode for family in families])
    axes.invert_yaxis()
    axes.set(xlabel="solved instances, %", title="cheapest solution family")


def _draw_modes(axes: Axes, reports: Reports) -> None:
    shifts, width = _offsets(len(reports))
    for i, (held, _) in enumerate(reports.values()):
        fraction = 100 * np.array(held.report.modes_found) / max(held.report.totals.problems, 1)
        axes.bar(np.arange(len(fraction)) + shifts[i], fraction, width, color=COLORS[i])
        axes.set_xticks(range(len(fraction)))
    axes.set(xlabel="solution families found", ylabel="instances, %", title="solution families found for an instance")


def _draw_histograms(axes: Axes, values: Mapping[tuple[int, str], Array], lowest: float) -> None:
    """Fractions on a logarithmic axis, by colour and line style; the first bin includes all below ``lowest``."""
    every = np.concatenate([np.empty(0), *values.values()])
    if not len(every):
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center")
        return
    low, high = (np.log10(np.maximum(limit, lowest)) for limit in (every.min(), every.max()))
    first, last = np.floor(low), max(np.ceil(high), np.floor(low) + 1)
    edges = np.logspace(first, last, _BINS_PER_DECADE * int(last - first) + 1)
    for (i, line), part in values.items():
        counts, _ = np.histogram(np.clip(part, edges[0], edges[-1]), edges)
        axes.stairs(100 * counts / max(len(part), 1), edges, color=COLORS[i], linestyle=line, linewidth=1.4)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)


def _draw_differences(axes: Axes, reports: Reports) -> None:
    _draw_histograms(axes, {(i, "-"): held.differences for i, (held, _) in enumerate(reports.values())}, 1e-6)
    for limit in CLOSE:
        axes.axvline(limit, color="black", linestyle=":", linewidth=0.8)
    axes.set(
        xlabel="(second − best) / best; dotted: 0.1 %, 1 %, 3 %",
        ylabel="instances with two families or more, %",
        title="relative cost difference of the two cheapest families",
    )


def _draw_accuracy(axes: Axes, reports: Reports) -> None:
    kinds = (("interval", ":", "per interval"), ("open_loop", "-", "open loop, x_0 to t_f"))
    values = {
        (i, line): found.errors(kind, scaled=True)
        for i, (_, found) in enumerate(reports.values())
        if found is not None
        for kind, line, _ in kinds
    }
    _draw_histograms(axes, values, 1e-10)
    for _, line, label in kinds:
        axes.plot([], [], line, color="#555555", label=label)
    axes.set_ylim(top=1.12 * axes.get_ylim()[1])  # space for the legend
    axes.legend(loc="upper center", ncols=2, fontsize=8)
    axes.set(
        xlabel="state error, scaled; the first bin includes all below",
        ylabel="intervals or plans, %",
        title="accuracy against the differential equation",
    )
