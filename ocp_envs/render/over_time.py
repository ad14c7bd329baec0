"""States and controls against time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.render.style import GOAL, INK, Axes, matplotlib
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


@checked
def plot_trajectory(problem: ProblemOrId, trajectory: Trajectory, axes: Axes = None) -> NDArray[np.object_]:
    """Plot the states and controls of trajectories against time, one panel per coordinate.

    Targets of the state are dotted lines, bounds of the control dashed ones. Returned are the axes, (nx + nu,), states
    first; ``axes[0].figure`` is the figure.

    Args:
        problem: the problem that the trajectories belong to.
        trajectory: a batch; each member is a line.
        axes: nx + nu Matplotlib axes to draw into; a new figure by default.

    Raises:
        ValueError: another number of axes, or trajectories of another problem.
        ImportError: Matplotlib is not installed.
    """
    problem = problem_of(problem)
    system = problem.system
    coordinates = (*system.state.coordinates, *system.control.coordinates)
    got, fits = (trajectory.states.shape[2], trajectory.controls.shape[2]), (system.nx, system.nu)
    if got != fits:
        raise ValueError(f"{problem.id}: expected trajectories with {fits} states and controls, got {got}")
    panels = _panels(len(coordinates)) if axes is None else np.asarray(axes).ravel()
    if len(panels) != len(coordinates):
        raise ValueError(f"{problem.id}: expected {len(coordinates)} axes (states, controls), got {len(panels)}")
    times = trajectory.times.T
    for i, panel in enumerate(panels[: system.nx]):
        panel.plot(times, trajectory.states[:, :, i].T, lw=1.5)
        for target in np.unique(problem.targets[:, i]) if problem.terminal.fixed[i] else ():
            panel.axhline(target, color=GOAL, lw=1, ls=":")
    held = np.concatenate([trajectory.controls, trajectory.controls[:, -1:]], axis=1)
    for i, panel in enumerate(panels[system.nx :]):
        panel.plot(times, held[:, :, i].T, lw=1.5, drawstyle="steps-post")
        for bound in (system.control.lower[i], system.control.upper[i]):
            panel.axhline(bound, color=INK, lw=1, ls="--")
    for coordinate, panel in zip(coordinates, panels):
        unit = "" if coordinate.unit == "1" else f" ({coordinate.unit})"
        panel.set_ylabel(f"{coordinate.name}{unit}")
        panel.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("time (s)")
    return panels


def _panels(count: int) -> NDArray[np.object_]:
    """``count`` axes in a new figure: one column of up to four, else four columns."""
    columns = 1 if count <= 4 else 4
    rows = math.ceil(count / columns)
    size = (3.2 * columns + 2.4 * (columns == 1), 1.8 * rows)
    figure = matplotlib("pyplot").figure(figsize=size, layout="constrained")
    axes: NDArray[np.object_] = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for unused in axes[count:]:
        unused.set_visible(False)
    return axes[:count]
