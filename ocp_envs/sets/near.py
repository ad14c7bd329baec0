"""Parameters near the goal: draws from the parameter box shrunk towards the goal's state.

Of the parameters that are initial values of the state, some or all are confined to a fraction f of their interval
[a, b], whose half width is w, round the value g that the goal gives them:

* an ordinary coordinate lies in [c − f (c − a), c + f (b − c)], where c is the point of [a, b] nearest to g (for a
  periodic coordinate, nearest to g plus some number of turns);
* a coordinate that covers a whole turn lies in [g − f w, g + f w], written as a value in [a, b].

All other parameters keep their intervals, and the draws follow the distribution of the problem over this box
(:mod:`ocp_envs.sets.sampling`). Initial states in the goal ball are left out, since there is nothing left to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.boxes import over, whole_turns
from ocp_envs.sets.sampling import sample
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box, Coordinate

#: Number of draws, all in the goal ball, after which no others are expected.
_PATIENCE = 1_000


def initial_values(problem: OptimalControlProblem) -> tuple[str, ...]:
    """Names of the parameters of ``problem`` that are initial values of state coordinates."""
    return tuple(name for name in problem.parameters.names if name in problem.system.state.names)


def near_goal(problem: OptimalControlProblem, fraction: float, names: Sequence[str] | None = None) -> Box:
    """The parameter box of ``problem`` shrunk towards the goal's state.

    A coordinate that covers a whole turn may leave its interval: the goal's value is its centre.

    Args:
        problem: the problem.
        fraction: f, of the width of the intervals, in (0, 1].
        names: of the coordinates that shrink; by default all that are initial values.

    Raises:
        ValueError: another fraction, or a name that is not that of an initial value, or no name.
    """
    chosen, known = initial_values(problem) if names is None else tuple(names), initial_values(problem)
    if not chosen or not set(chosen) <= set(known):
        raise ValueError(
            f"{problem.id}: expected coordinates from {list(known)}, the parameters that are initial values, got "
            f"{list(chosen)}"
        )
    if not 0 < fraction <= 1:
        raise ValueError(f"{problem.id}: expected 0 < fraction ≤ 1, got {fraction}")
    whole = dict(zip(problem.parameters.names, whole_turns(problem)))

    def shrunk(c: Coordinate) -> Coordinate:
        if c.name not in chosen:
            return c
        goal, centre, half = _goal_value(problem, c), (c.upper + c.lower) / 2, (c.upper - c.lower) / 2
        inside = float(np.clip(goal, c.lower, c.upper))
        middle = goal if whole[c.name] else centre + (1 - fraction) * (inside - centre)
        return replace(c, lower=middle - fraction * half, upper=middle + fraction * half)

    return Box(tuple(map(shrunk, problem.parameters.coordinates)))


def _goal_value(problem: OptimalControlProblem, c: Coordinate) -> float:
    """The goal's value of ``c``, that turn of it which is nearest to the centre of its interval."""
    index = problem.system.state.names.index(c.name)
    goal, period = float(problem.goal.state[index]), problem.system.state.periods[index]
    return goal + period * round(((c.upper + c.lower) / 2 - goal) / period) if period else goal


def sample_near(
    problem: OptimalControlProblem,
    seed: int,
    n: int,
    fraction: float,
    names: Sequence[str] | None = None,
    *,
    workers: int | None = 1,
) -> Array:
    """``n`` parameters near the goal, (n, np); a smaller draw is the beginning of a larger one.

    Args:
        problem: the problem.
        seed: of the draw.
        n: number of parameters.
        fraction: of the width of the intervals, see :func:`near_goal`.
        names: of the coordinates that shrink; by default all that are initial values.
        workers: number of processes, where drawing needs solutions; ``None`` for one per core.

    Raises:
        ValueError: a fraction or names that :func:`near_goal` refuses, or only initial states in the goal ball.
        RuntimeError: an obstacle has to block the free optimum, and no draw does.
    """
    box = near_goal(problem, fraction, names)
    by_name = dict(zip(box.names, box.coordinates))
    near = over(problem, lambda other: Box(tuple(by_name[c.name] for c in other.coordinates)))
    count, found = n, np.empty((0, len(box)))
    while len(found) < n:
        drawn = _in_the_box(problem, sample(near, seed, count, workers=workers))  # begins with what was drawn before
        found = drawn[problem.goal_error(problem.start(drawn)[0]) >= problem.goal.radius]
        if not len(found) and count >= _PATIENCE:
            raise ValueError(
                f"{problem.id}: {count} draws with the fraction {fraction} all begin in the goal ball, whose radius is "
                f"{problem.goal.radius}; choose a larger fraction"
            )
        count *= 2
    return found[:n]


def _in_the_box(problem: OptimalControlProblem, p: Array) -> Array:
    """Parameters ``p`` (B, np) with the coordinates that cover a whole turn written as values in the box."""
    box, names = problem.parameters, problem.system.state.names
    turns = {name: period for name, period in zip(names, problem.system.state.periods) if period}
    periods = np.where(whole_turns(problem), [turns.get(name, 0.0) for name in box.names], 0.0)
    return p + periods * (p < box.lower) - periods * (p > box.upper)
