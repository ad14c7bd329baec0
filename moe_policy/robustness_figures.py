"""Curves of success under perturbed plants."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from moe_policy.reporting import COLORS, save_figure
from moe_policy.robustness import Perturbation

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def robustness_figure(
    path: str | os.PathLike[str], rows: Sequence[Mapping[str, Any]], perturbations: Sequence[Perturbation]
) -> Path:
    """A panel for each perturbation: success against the level, a curve with its 95 % band for each contestant.

    Dashed where there is a plan: success at its end, before any hold.

    Args:
        path: file to write.
        rows: of :func:`~moe_policy.robustness.run_level`, all levels together.
        perturbations: what the panels show.
    """
    names = list(dict.fromkeys(row["name"] for row in rows))
    columns = 3

    def draw(figure: Figure) -> None:
        panels = figure.subplots(-(-len(perturbations) // columns), columns, sharey=True, squeeze=False).ravel()
        for ax, perturbation in zip(panels, perturbations):
            for name, color in zip(names, COLORS):
                points = [row for row in rows if (row["name"], row["perturbation"]) == (name, perturbation.name)]
                at = [row["level"] for row in points]
                bounds = [[100 * row["success"]["interval"][side] for row in points] for side in (0, 1)]
                ax.fill_between(at, *bounds, color=color, alpha=0.15, linewidth=0)
                shares = [100 * row["success"]["fraction"] for row in points]
                ax.plot(at, shares, "o-", color=color, label=name, markersize=2.5, linewidth=1.2)
                ends = [row["success_at_plan_end"] for row in points]
                if None not in ends and any(end != row["success"] for end, row in zip(ends, points)):
                    ax.plot(at, [100 * end["fraction"] for end in ends], "--", color=color, linewidth=0.8)
            if perturbation.kind in ("noise", "disturbance"):
                ax.set_xscale("symlog", linthresh=min(level for level in perturbation.levels if level > 0))
            ax.set_xlabel(perturbation.label)
            ax.set_ylim(-3, 103)
        for ax in panels[::columns]:
            ax.set_ylabel("success, %")
        for ax in panels[len(perturbations) :]:
            ax.set_axis_off()
        handles = panels[0].get_legend_handles_labels()
        if len(perturbations) < len(panels):
            panels[-1].legend(*handles, loc="center", title="dashed: at the plan's end")
        else:
            figure.legend(*handles, loc="outside lower center", ncols=len(names))

    return save_figure(path, (10.0, 2.9 * -(-len(perturbations) // columns)), draw)
