"""The figure of initial positions that rise past a sphere, where the optimum changes sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.benchmark.parts import Rise
from moe_policy.experiments.figures.space import INK, closeup, draw_goal, draw_path, grid, panel, spheres_of
from moe_policy.experiments.figures.style import Axes, Figure, save_figure
from moe_policy.planners.scaling import Standardizer
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import path_violation
from ocp_envs.solvers.optimum import solve
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

_COLORS_OF_PROGRESS = "plasma", 0.02, 0.82  # the rest of the map is too light


def rise_parameters(problem: OptimalControlProblem, rise: Rise) -> Array:
    """Parameters (count, np) along which the initial position rises past a sphere, but never inside it."""
    names = ("x", "y", "z", "cx", "cy", "cz", "radius")
    if problem.parameters.names != names:
        raise ValueError(f"{problem.id}: expected the parameters {names}, got {problem.parameters.names}")
    if rise.count < 2:
        raise ValueError(f"expected at least 2 initial positions, got {rise.count}")
    p = np.empty((rise.count, 7))
    p[:, :2], p[:, 3:6], p[:, 6] = rise.start, rise.centre, rise.radius
    p[:, 2] = np.linspace(*rise.heights, rise.count)
    p = problem.check_parameters(p)
    inside = np.linalg.norm(p[:, :3] - p[:, 3:6], axis=1) < rise.radius
    if inside.any():
        raise ValueError(f"positions at z = {p[inside, 2].tolist()} are inside the sphere; choose another start")
    return p


def follow(problem: OptimalControlProblem, solver: GuardedSolver, p: Array) -> tuple[Trajectory, Array]:
    """The family of the best solution of p[0] along closely spaced ``p`` (K, np), and its costs (K,).

    Each instance is solved from the solution of the previous one; where the family ends, plan and cost are NaN and
    +inf.
    """
    best = solve(problem, p[0], starts=12)
    plans, costs, guess = [best.trajectory], [best.cost], best.trajectory
    for row in p[1:]:
        found = solver.solve(row[None], guess, np.zeros(1, np.int64))
        plans.append(found.trajectory)
        costs.append(float(found.cost[0]))
        guess = found.trajectory if found.solved[0] else guess
    return Trajectory.concatenate(plans), np.array(costs)


def find_discontinuity(optimal: Trajectory) -> int:
    """The index i of the largest step in a sequence of optimal trajectories, from i to i + 1.

    Steps are Euclidean distances of flat trajectories, every component standardised over the sequence; of equal ones
    the first counts.
    """
    if len(optimal) < 2:
        raise ValueError(f"expected at least two trajectories, got {len(optimal)}")
    flat = optimal.flat()
    steps = np.diff(Standardizer.fit(flat).scale(flat), axis=0)
    return int(np.linalg.norm(steps, axis=1).argmax())


def plan_violations(problem: OptimalControlProblem, parameters: ArrayLike, plans: Trajectory) -> Array:
    """The largest violation of the path constraints at the knots of each plan, (B,), at least 0; metres for a sphere.

    A plan that is not finite gives NaN.
    """
    if not problem.n_clearances:
        raise ValueError(f"{problem.id} has no path constraints that a plan could violate")
    p = problem.check_parameters(parameters, extrapolate=True)
    if len(plans) != len(p) or plans.states.shape[2] != problem.system.nx:
        raise ValueError(
            f"{problem.id}: expected {len(p)} plans of {problem.system.nx} states, one for each parameter, "
            f"got states of shape {plans.states.shape}"
        )
    return np.where(plans.finite, path_violation(problem, plans, problem.start(p)[1]), np.nan)


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
    path: str | Path,
    problem: OptimalControlProblem,
    parameters: ArrayLike,
    optimal: Trajectory,
    plans: Mapping[str, Trajectory],
) -> Path:
    """Plans along a path of parameters (K, np), in colour from first to last: a panel for the optimum and each planner.

    All parameters have one sphere. Titles give the largest violation at the knots; a black line in the scale of colours
    marks where the optimum changes sides. Next to the colours are the values of the
    parameter that changes most.
    """
    p, every = problem.check_parameters(parameters, extrapolate=True), {"optimal": optimal, **plans}
    worst = {name: plan_violations(problem, p, batch).max() for name, batch in every.items()}
    change, contexts, varied = find_discontinuity(optimal), problem.start(p)[1], int(np.ptp(p, axis=0).argmax())
    if np.ptp(contexts, axis=0).any():
        raise ValueError(f"expected one ({', '.join(problem.context.names)}) for all parameters, got different ones")
    texts = [f"{value:.3g}" for value in p[:, varied]]
    spheres = spheres_of(problem, contexts[0])
    picture = closeup(problem, Trajectory.concatenate(list(every.values())), spheres)
    size, bounds = grid(len(every), 4, 3.0, 3.2, right=0.9)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        scale = figure.add_axes((1 - 0.72 / size[0], 0.2, 0.16 / size[0], 0.6))
        colors = _draw_scale(scale, texts, change)
        scale.set_title(f"{problem.parameters.names[varied]}, {problem.parameters.coordinates[varied].unit}")
        for place, (name, batch) in zip(bounds, every.items()):
            space = panel(figure, place, picture, f"{name}\nworst violation {worst[name]:.3f} m")
            space.show(spheres)
            for states, color in zip(batch.states, colors):
                draw_path(space, picture, states, color, 1.4)
            draw_goal(space, picture, problem)

    return save_figure(path, size, draw)
