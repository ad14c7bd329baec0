"""Figures of paths in space: samples by cluster, and samples around one instance.

They are those of Tang & Hauser (2019), section V-C (the quadcopter with a sphere), for any problem whose
:class:`~ocp_envs.picture.Picture` traces a path in space.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.figures.paths import (
    check_labels,
    closeup,
    cluster_text,
    draw_goal,
    draw_path,
    grid,
    panel,
    picture_of,
    spheres_of,
)
from moe_policy.experiments.figures.style import cluster_color, save_figure
from moe_policy.learning.clustering import Labels
from moe_policy.planners.nearest import NearestPlanner
from ocp_envs.data.samples import Samples

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def samples_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, shown: int = 25, seed: int = 0
) -> Path:
    """Paths in space of at most ``shown`` samples a cluster, a panel for each cluster; dots are initial positions.

    Spheres are not drawn, as each sample has its own.
    """
    problem, generator = samples.problem, np.random.default_rng(seed)
    picture = picture_of(problem)
    check_labels(samples, labels)
    if shown < 1:
        raise ValueError(f"shown must be at least 1, got {shown}")
    chosen = [generator.permutation(np.flatnonzero(labels.values == i))[:shown] for i in range(labels.k)]
    size, bounds = grid(labels.k, 5, 2.2, 2.35, right=0.1)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")  # the panels have their places
        for i, rows in enumerate(chosen):
            space = panel(figure, bounds[i], picture, f"{cluster_text(labels.names[i])}: {labels.sizes[i]:,}")
            for row in rows:
                draw_path(space, picture, samples.trajectory.states[row], cluster_color(i), 0.8, 0.8)
            draw_goal(space, picture, problem)

    return save_figure(path, size, draw)


def around_figure(
    path: str | os.PathLike[str], samples: Samples, labels: Labels, parameters: ArrayLike, count: int = 40
) -> Path:
    """Optimal paths, by cluster, of the ``count`` samples nearest to ``parameters`` (np,), around the sphere of that p.
    """
    problem = samples.problem
    picture_of(problem)
    check_labels(samples, labels)
    p = problem.check_parameters(parameters, extrapolate=True)
    if len(p) != 1:
        raise ValueError(f"expected one parameter ({len(problem.parameters)},), got {np.shape(parameters)}")
    rows = NearestPlanner(samples).neighbours(p, count)[0]
    spheres = spheres_of(problem, problem.start(p)[1][0])
    picture = closeup(problem, samples.trajectory[rows], spheres)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        space = panel(figure, (0.0, 0.0, 0.74, 1.08), picture)  # nothing is drawn in the upper part
        space.show(spheres)
        for row, cluster in zip(rows, labels.values[rows]):
            draw_path(space, picture, samples.trajectory.states[row], cluster_color(cluster), 1.3, 0.9)
        draw_goal(space, picture, problem)
        for i, number in zip(*np.unique(labels.values[rows], return_counts=True)):
            space.axes.plot([], [], [], color=cluster_color(i), label=f"{cluster_text(labels.names[i])}: {number}")
        handles = space.axes.get_legend_handles_labels()
        figure.legend(*handles, loc="center left", bbox_to_anchor=(0.77, 0.5), title="cluster: samples")

    return save_figure(path, (6.8, 4.6), draw)
