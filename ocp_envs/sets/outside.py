"""Parameters outside the box: how far they lie beyond it, and draws at a given distance.

With centre c and half width w of a coordinate of the parameter box, the *excess* of p is

    e(p) = max over coordinates of (|p − c| / w − 1),

below 0 inside the box. Coordinates that cover a whole turn of a periodic state coordinate are left out: beyond one end
of them lie the initial states at the other end. Draws with e(p) in [low, high] follow the distribution of the problem
over a widened box, restricted to that shell (:mod:`ocp_envs.sets.sampling`).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.boxes import over, whole_turns
from ocp_envs.sets.sampling import sample
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box

#: Minimum number of candidates of a draw, unless fewer than half as many parameters are wanted.
_BLOCK = 1_000


def open_coordinates(problem: OptimalControlProblem) -> NDArray[np.bool_]:
    """Which parameters of ``problem`` have an outside, (np,): those that cover no whole turn of a state coordinate."""
    return ~whole_turns(problem)


def excess(problem: OptimalControlProblem, p: Array) -> Array:
    """e(p) of parameters (B, np) of ``problem``, in half widths, (B,).

    Raises:
        ValueError: no coordinate has an outside.
    """
    chosen, box = open_coordinates(problem), problem.parameters
    if not chosen.any():
        raise ValueError(f"{problem.id}: every parameter covers a whole turn, so that nothing lies outside")
    centre, half = box.centre, box.width / 2
    return np.asarray((np.abs(p - centre) / half - 1)[:, chosen].max(axis=1))


def widened(problem: OptimalControlProblem, fraction: float) -> OptimalControlProblem:
    """``problem`` with a parameter box wider by ``fraction`` of the half width at each end that has an outside."""
    chosen = dict(zip(problem.parameters.names, open_coordinates(problem)))

    def wider(box: Box) -> Box:
        reach = {c.name: fraction * chosen[c.name] * (c.upper - c.lower) / 2 for c in box.coordinates}
        coordinates = (
            dataclasses.replace(c, lower=c.lower - reach[c.name], upper=c.upper + reach[c.name])
            for c in box.coordinates
        )
        return Box(tuple(coordinates))

    return over(problem, wider)


def sample_outside(
    problem: OptimalControlProblem, seed: int, n: int, beyond: tuple[float, float], *, workers: int | None = 1
) -> Array:
    """``n`` parameters with an excess in ``beyond``, (n, np); a smaller draw is the beginning of a larger one.

    Args:
        problem: the problem.
        seed: of the draw.
        n: number of parameters.
        beyond: range of the excess, in half widths.
        workers: number of processes, where drawing needs solutions; ``None`` for one per core.

    Raises:
        ValueError: an empty shell, or no coordinate that has an outside.
    """
    low, high = beyond
    if not 0 <= low < high:
        raise ValueError(f"{problem.id}: expected 0 ≤ low < high for the range of the excess, got {beyond}")
    wide = widened(problem, high)
    count, found = min(_BLOCK, 2 * n), np.empty((0, len(problem.parameters)))
    while len(found) < n:
        drawn = sample(wide, seed, count, workers=workers)  # begins with what was drawn before
        found = drawn[excess(problem, drawn) > low]
        count *= 2
    return found[:n]
