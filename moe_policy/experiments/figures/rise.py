"""The figure of plans along a path of parameters, where the optimum changes sides."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.figures.cases import find_discontinuity, plan_violations
from moe_policy.experiments.figures.paths import INK, closeup, draw_goal, draw_path, grid, panel, spheres_of
from moe_policy.experiments.figures.style import save_figure
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS_OF_PROGRESS = "plasma", 0.02, 0.82  # the rest of the map is too light


def _draw_scale(axes: Axes, texts: Sequence[str], change: int) -> Array:
    """A scale of colours from first to last, upwards, with a line after row ``change``; returns them, (K, 4)."""
    from matplotlib import colormaps

    name, first, last = _COLORS_OF_PROGRESS
    colors = np.asarray(colormaps[name](np.linspace(first, last, len(texts))))
    axes.imshow(colors[:, None], origin="lower", aspect="auto")
    axes.axhline(change + 0.5, color=INK, linewidth=2)
    axes.grid(False)
    axes.spines[:].set_visible(False)
    shown = slice(None, None, -(-len(texts) // 12))
    axes.set_xticks([])
    axes.set_yticks(range(len(texts))[shown], texts[shown])
    axes.yaxis.tick_right()
    return colors


def rise_figure(
    path: str | os.PathLike[str],
    problem: OptimalControlProblem,
    parameters: ArrayLike,
    optimal: Trajectory,
    plans: Mapping[str, Trajectory],
    labels_of_lines: Sequence[str] | None = None,
) -> Path:
    """Plans along a path of parameters (K, np), in colour from first to last: a panel for the optimum and each planner.

    All parameters have one sphere. Titles give the largest violation at the knots; a black line in the scale of colours
    marks where the optimum changes sides. Next to the colours are the ``labels_of_lines``, by default the values of the
    parameter that changes most.
    """
    p, every = problem.check_parameters(parameters, extrapolate=True), {"optimal": optimal, **plans}
    if wrong := {name: len(batch) for name, batch in every.items() if len(batch) != len(p)}:
        raise ValueError(f"expected {len(p)} trajectories, one for each parameter, got {wrong}")
    worst = {name: plan_violations(problem, p, batch).max() for name, batch in every.items()}
    change, contexts, varied = find_discontinuity(optimal), problem.start(p)[1], int(np.ptp(p, axis=0).argmax())
    if np.ptp(contexts, axis=0).any():
        raise ValueError(f"expected one ({', '.join(problem.context.names)}) for all parameters, got different ones")
    texts = [f"{value:.3g}" for value in p[:, varied]] if labels_of_lines is None else list(labels_of_lines)
    if len(texts) != len(p):
        raise ValueError(f"expected a label for each of {len(p)} lines, got {len(texts)}")
    spheres = spheres_of(problem, contexts[0])
    picture = closeup(problem, Trajectory.concatenate(list(every.values())), spheres)
    size, bounds = grid(len(every), 4, 3.0, 3.2, right=0.9)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        scale = figure.add_axes((1 - 0.72 / size[0], 0.2, 0.16 / size[0], 0.6))
        colors = _draw_scale(scale, texts, change)
        if labels_of_lines is None:
            scale.set_title(f"{problem.parameters.names[varied]}, {problem.parameters.coordinates[varied].unit}")
        for place, (name, batch) in zip(bounds, every.items()):
            space = panel(figure, place, picture, f"{name}\nworst violation {worst[name]:.3f} m")
            space.show(spheres)
            for states, color in zip(batch.states, colors):
                draw_path(space, picture, states, color, 1.4)
            draw_goal(space, picture, problem)

    return save_figure(path, size, draw)
