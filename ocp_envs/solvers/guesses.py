"""Initial guesses for the optimiser."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.trajectory import Trajectory

#: "line": straight in state space, with the control that keeps the system at the goal; coordinates whose final value is
#: free follow the equation of motion, so that a clock, or an integral, is right. "rollout": the motion under
#: random controls. "drift": such a motion with a linear drift added, so that it ends at the target. "bend": the line
#: with half a sine wave added to every coordinate, whose height is normally distributed with a standard deviation of
#: two scales, to pass an obstacle on all sides.
GuessKind = Literal["line", "rollout", "drift", "bend"]
#: Guesses of B instances: B trajectories, several times B, or what makes them from parameters (B, np), as planners do.
Guess = Trajectory | Sequence[Trajectory] | Callable[[Array], Trajectory | Sequence[Trajectory]]
#: Instead of an index into ``problem.targets``: the winding whose target is nearest to the end of the guess.
NEAREST_WINDING = -1
_BEND = 2.0
#: The same for bends of a solution. With two scales, fatrop hangs or takes long on many of them.
_BEND_OF_SOLUTION = 1.0
_PIECES = 4


def random_kind(problem: OptimalControlProblem) -> GuessKind:
    """The kind of random guesses for a ``problem`` of which nothing else is known.

    Random motions find solution families that differ in the winding of the goal. Where the goal is a single state they
    do not help, and for the quadcopter fatrop hangs on many of them.
    """
    return "drift" if len(problem.terminal) > 1 else "bend"


def guesses(
    problem: OptimalControlProblem,
    parameters: Array,
    windings: NDArray[np.integer],
    rng: np.random.Generator,
    kind: GuessKind = "drift",
) -> Trajectory:
    """One guess of a ``kind`` (:data:`GuessKind`) for each instance of ``problem`` with ``parameters`` (B, np).

    It ends at the target of its winding, an index into ``problem.targets`` in ``windings`` (B,), unless it is a
    rollout. The random controls (piecewise constant) and t_f (uniform in the third quarter of its range) come from
    ``rng``.

    Raises:
        ValueError: an unknown kind.
    """
    if kind not in get_args(GuessKind):
        raise ValueError(f"kind must be one of {get_args(GuessKind)}, got {kind!r}")
    initial, contexts = problem.start(parameters)
    shortest, longest = problem.horizon.of(contexts).T
    duration = shortest + (longest - shortest) * rng.uniform(0.5, 0.75, len(parameters))
    if kind in ("line", "bend"):
        targets = _targets(problem, initial, contexts, windings)
        states = initial[:, None] + _progress(problem) * (targets - initial)[:, None]
        if kind == "bend":
            states = _bent(problem, states, rng, np.full(len(states), _BEND))
        held = _held(problem, contexts)
        states = _with_free_coordinates(problem, states, held, contexts, duration, windings)
        return Trajectory(states, np.repeat(held[:, None], problem.knots - 1, axis=1), duration)
    controls = _random_controls(problem, contexts, rng)
    states = _rollout(problem, parameters, controls, duration)
    if kind == "drift":
        states = _drifted(problem, states, _targets(problem, states[:, -1], contexts, windings))
    return Trajectory(states, controls, duration)


def guesses_of(problem: OptimalControlProblem, given: Array, guess: Guess | None, name: str) -> list[Trajectory]:
    """The trajectories of the argument ``guess``, called ``name``, for instances of ``problem``.

    The instances have the parameters ``given`` (B, np), in the turns in which they were written.

    Raises:
        TypeError: something else than trajectories.
        ValueError: none, or trajectories of another problem or of another number of instances.
    """
    if guess is None:
        return []
    made = guess(given) if callable(guess) and not isinstance(guess, type) else guess
    every = [made] if isinstance(made, Trajectory) else made
    if not isinstance(every, Sequence) or not all(isinstance(each, Trajectory) for each in every):
        raise TypeError(f"{name}: expected trajectories, or a function that returns some; got {made!r:.80}")
    size, system, knots = len(given), problem.system, problem.knots
    expected = (size, knots, system.nx), (size, knots - 1, system.nu)
    for each in every:
        if (each.states.shape, each.controls.shape) != expected:
            raise ValueError(
                f"{name}: expected states {expected[0]} and controls {expected[1]}, a trajectory of {problem.id} for "
                f"each of {size} instances; got {each.states.shape} and {each.controls.shape}"
            )
    return list(every)


def bends_of(
    problem: OptimalControlProblem, lines: Trajectory, solved: Bools, solutions: Trajectory, rng: np.random.Generator
) -> Trajectory:
    """Random bends of B ``lines`` to ``problem``, or of the ``solutions`` (B) found from them where ``solved`` (B,).

    Near a solution the random numbers from ``rng`` move the guess to the other sides of an obstacle while the rest of
    it stays plausible: on the quadcopters a solve takes a third of the iterations, and hangs a tenth as often.
    """
    states = np.where(solved[:, None, None], solutions.states, lines.states)
    states = _bent(problem, states, rng, np.where(solved, _BEND_OF_SOLUTION, _BEND))
    return dataclasses.replace(lines.replaced(solved, solutions[solved]), states=states)


def _targets(problem: OptimalControlProblem, near: Array, contexts: Array, windings: NDArray[np.integer]) -> Array:
    """The state nearest to ``near`` (B, nx) in the target of each winding in ``contexts`` (B, nc), (B, nx)."""
    return np.asarray(problem.terminal.nearest(near, contexts)[np.arange(len(near)), windings])


def _with_free_coordinates(
    problem: OptimalControlProblem,
    states: Array,
    held: Array,
    contexts: Array,
    duration: Array,
    windings: NDArray[np.integer],
) -> Array:
    """``states`` (B, N, nx) in which coordinates that are free at the end follow the equation of motion from the first.

    The others stay. The controls are ``held`` (B, nu), in ``contexts`` (B, nc), over the ``duration`` (B,), to the
    targets of the ``windings`` (B,).
    """
    lower, upper = (side[np.arange(len(states)), windings] for side in problem.terminal.bounds(contexts))
    free = np.isinf(lower) & np.isinf(upper)
    if not free.any():
        return states
    box, rate, following = problem.planned_states, problem.functions.rate(), states.copy()
    step = (duration / (problem.knots - 1))[:, None]
    for k in range(problem.knots - 1):
        slope, _ = rate(following[:, k], held, contexts)
        moved = following[:, k] + step * np.where(np.isfinite(slope), slope, 0.0)
        following[:, k + 1] = np.where(free, np.clip(moved, box.lower, box.upper), states[:, k + 1])
    return following


def _progress(problem: OptimalControlProblem) -> Array:
    """From 0 at the first knot to 1 at the last one, (N, 1)."""
    return np.linspace(0.0, 1.0, problem.knots)[:, None]


def _bent(problem: OptimalControlProblem, states: Array, rng: np.random.Generator, height: Array) -> Array:
    """``states`` (B, N, nx) with half a sine wave added to every coordinate, between the ends.

    Its standard deviation is ``height`` (B,), in scales.
    """
    box = problem.planned_states
    heights = rng.normal(0.0, height[:, None, None], (len(states), 1, problem.system.nx)) * box.scale
    wave = np.sin(np.pi * _progress(problem))
    wave[[0, -1]] = 0.0
    return np.clip(states + wave * heights, box.lower, box.upper)


def _rollout(problem: OptimalControlProblem, parameters: Array, controls: Array, duration: Array) -> Array:
    """States of the motion under ``controls`` (B, N − 1, nu), clipped to the box at every knot, (B, N, nx)."""
    initial, contexts = problem.start(parameters)
    box, flow = problem.planned_states, problem.functions.flow(problem.substeps)
    step = (duration / (problem.knots - 1))[:, None]
    states = [initial]
    for k in range(problem.knots - 1):
        following, _ = flow(states[k], controls[:, k], contexts, step)
        states.append(np.clip(following, box.lower, box.upper))
    return np.stack(states, axis=1)


def _drifted(problem: OptimalControlProblem, states: Array, targets: Array) -> Array:
    """``states`` (B, N, nx) with a linear drift added, so that they end at ``targets`` (B, nx)."""
    box = problem.planned_states
    drifted = np.clip(states + _progress(problem) * (targets - states[:, -1])[:, None], box.lower, box.upper)
    drifted[:, 0] = states[:, 0]
    return drifted


def _held(problem: OptimalControlProblem, contexts: Array) -> Array:
    """The control that keeps the system at the goal in ``contexts`` (B, nc), inside the box of plans, (B, nu)."""
    box = problem.planned_controls
    return np.clip(problem.terminal.controls(contexts), box.lower, box.upper)


def _random_controls(problem: OptimalControlProblem, contexts: Array, rng: np.random.Generator) -> Array:
    """Piecewise constant controls within one scale of the one that keeps the system at the goal, (B, N − 1, nu).

    The instances have ``contexts`` (B, nc).
    """
    box, size = problem.planned_controls, len(contexts)
    drawn = _held(problem, contexts)[:, None] + rng.uniform(-1, 1, (size, _PIECES, problem.system.nu)) * box.scale
    piece = np.arange(problem.knots - 1) * _PIECES // (problem.knots - 1)
    return np.clip(drawn, box.lower, box.upper)[:, piece]
