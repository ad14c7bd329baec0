"""Initial guesses for the optimiser."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: "line": straight in state space, controls that hold the goal. "rollout": the motion under random controls.
#: "drift": such a motion with a linear drift added, so that it ends at the target. "bend": the line with half a sine
#: wave of random height added to every coordinate, normal with two scales: to pass an obstacle on all sides.
GuessKind = Literal["line", "rollout", "drift", "bend"]
#: Instead of an index into ``problem.targets``: the winding whose target is nearest to the end of the guess.
NEAREST_WINDING = -1
_BEND = 2.0
_PIECES = 4


def random_kind(problem: OptimalControlProblem) -> GuessKind:
    """The kind of random guesses for a ``problem`` of which nothing else is known.

    Random motions find solution families that differ in the winding of the goal. Where the goal is a single state they
    do not help, and for the quadcopter fatrop hangs on many of them.
    """
    return "drift" if len(problem.targets) > 1 else "bend"


def guesses(
    problem: OptimalControlProblem,
    parameters: Array,
    windings: NDArray[np.integer],
    rng: np.random.Generator,
    kind: GuessKind = "drift",
) -> Trajectory:
    """One guess for each of B instances.

    Args:
        problem: the problem.
        parameters: (B, np).
        windings: (B,) indices into ``problem.targets``.
        rng: source of the random controls (piecewise constant) and of t_f (uniform in the third quarter of its range).
        kind: see :data:`GuessKind`.

    Raises:
        ValueError: an unknown kind.
    """
    if kind not in get_args(GuessKind):
        raise ValueError(f"kind must be one of {get_args(GuessKind)}, got {kind!r}")
    size, knots, system = len(parameters), problem.knots, problem.system
    starts, contexts = problem.start(parameters)
    shortest, longest = problem.duration
    duration = shortest + (longest - shortest) * rng.uniform(0.5, 0.75, size)
    progress = np.linspace(0.0, 1.0, knots)[:, None]
    targets = problem.targets[windings]
    if kind in ("line", "bend"):
        states = starts[:, None] + progress * (targets - starts)[:, None]
        if kind == "bend":
            height = rng.normal(0.0, _BEND, (size, 1, system.nx)) * system.state.scale
            states[:, 1:-1] += (np.sin(np.pi * progress) * height)[:, 1:-1]
            np.clip(states, system.state.lower, system.state.upper, out=states)
        return Trajectory(states, np.tile(problem.goal.control, (size, knots - 1, 1)), duration)
    controls = _random_controls(problem, size, rng)
    states = np.empty((size, knots, system.nx))
    states[:, 0] = starts
    flow = problem.batch_flow(problem.substeps)
    step = (duration / (knots - 1))[:, None]
    for k in range(knots - 1):
        following, _ = flow(states[:, k], controls[:, k], contexts, step)
        states[:, k + 1] = np.clip(following, system.state.lower, system.state.upper)
    if kind == "drift":
        states += progress * (targets - states[:, -1])[:, None]
        np.clip(states, system.state.lower, system.state.upper, out=states)
        states[:, 0] = starts
    return Trajectory(states, controls, duration)


def _random_controls(problem: OptimalControlProblem, size: int, rng: np.random.Generator) -> Array:
    """Piecewise constant, within one scale of the control that holds the goal."""
    box = problem.system.control
    drawn = problem.goal.control + rng.uniform(-1, 1, (size, _PIECES, problem.system.nu)) * box.scale
    piece = np.arange(problem.knots - 1) * _PIECES // (problem.knots - 1)
    return np.clip(drawn, box.lower, box.upper)[:, piece]
