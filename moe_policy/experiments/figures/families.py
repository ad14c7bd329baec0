"""Solution families over two parameters, and how much more the second best one costs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from moe_policy.experiments.figures.style import Axes, Figure, cluster_color, save_figure
from moe_policy.learning.graph_cuts import Parts
from ocp_envs.data.samples import Samples
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.support.arrays import Array

#: Range of the cost gap that is told apart by colour.
_GAP = (1e-3, 1.0)


def families_figure(
    path: str | Path,
    samples: Samples,
    parts: Parts,
    costs: Array | None = None,
    names: Sequence[str] | None = None,
    shown: int = 20_000,
) -> Path:
    """Two panels over the parameters called ``names``, by default the first two, with the first ``shown`` samples.

    Left: the ``parts`` of ``samples``. Right, where the ``costs`` (M, k) of the families are given, +inf where they are
    unknown: the relative cost gap (J_second − J_best) / |J_best|, grey where a single one is known.
    """
    box, few = samples.problem.parameters, samples[:shown]
    first, second = (box.names.index(name) for name in names or box.names[:2])
    x, y = few.parameters[:, first], few.parameters[:, second]
    gap = np.full(len(few), np.inf) if costs is None else relative_cost_difference(costs[:shown])
    known = np.isfinite(gap)

    def draw(figure: Figure) -> None:
        from matplotlib.colors import LogNorm

        axes = figure.subplots(1, 2 if known.any() else 1, sharex=True, sharey=True, squeeze=False)[0]
        sizes = np.bincount(parts.values)
        for part, size in enumerate(sizes):
            here = parts.values[: len(few)] == part
            label = f"family {part}: {size:,}"
            axes[0].scatter(x[here], y[here], color=cluster_color(part), s=5, linewidths=0, label=label)
        axes[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize=7, markerscale=2)
        axes[0].set_title("families found by continuation")
        if known.any():
            axes[1].scatter(x[~known], y[~known], color="#cccccc", s=5, linewidths=0)
            shade = axes[1].scatter(
                x[known], y[known], c=np.clip(gap[known], *_GAP), norm=LogNorm(*_GAP), cmap="viridis", s=5, linewidths=0
            )
            figure.colorbar(shade, ax=axes[1], label="(second best − best) / best cost")
            axes[1].set_title("cost gap between the families")
        for ax in axes:
            _name(ax, samples, first, second)

    return save_figure(path, (9.0 if known.any() else 4.6, 4.2), draw)


def _name(axes: Axes, samples: Samples, first: int, second: int) -> None:
    for index, setter in ((first, axes.set_xlabel), (second, axes.set_ylabel)):
        coordinate = samples.problem.parameters.coordinates[index]
        setter(f"{coordinate.name}, {coordinate.unit}")
