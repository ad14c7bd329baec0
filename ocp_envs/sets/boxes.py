"""Changed parameter boxes of a problem, from which sets outside the box or near the goal are drawn."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Box

#: A coordinate that covers this fraction of a turn covers the whole one.
_WHOLE = 1 - 1e-9


def whole_turns(problem: OptimalControlProblem) -> NDArray[np.bool_]:
    """Which parameters of ``problem`` cover a whole turn of a periodic state coordinate, (np,)."""
    periods = {c.name: c.period for c in problem.system.state.coordinates if c.period is not None}
    box = problem.parameters.coordinates
    return np.array([c.upper - c.lower >= periods.get(c.name, np.inf) * _WHOLE for c in box])


def over(problem: OptimalControlProblem, change: Callable[[Box], Box]) -> OptimalControlProblem:
    """``problem`` with its distribution over another parameter box.

    Args:
        problem: the problem.
        change: old box → new box with the same coordinates; also applied to the boxes of problems that the
            distribution refers to, which have some of the coordinates.
    """
    distribution = problem.distribution.over(change)
    return dataclasses.replace(problem, parameters=change(problem.parameters), distribution=distribution)
