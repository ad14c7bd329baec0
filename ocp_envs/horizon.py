"""How long the trajectories of a problem last: bounds of t_f, which may be functions of the context."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


class Horizon:
    """The durations of the trajectories of ``problem``.

    Attributes:
        fixed: whether the duration is given.
        numeric: whether its bounds are the same in all contexts.
        longest: an upper bound of the durations, seconds: the time limit where they depend on the context.
    """

    @checked
    def __init__(self, problem: OptimalControlProblem) -> None:
        shortest, longest = problem.duration
        self._problem = problem
        self.fixed = shortest == longest
        self.numeric = not (callable(shortest) or callable(longest))
        self.longest = problem.time_limit if callable(longest) else float(longest)

    def of(self, contexts: Array) -> Array:
        """The shortest and the longest duration in ``contexts`` (B, nc), seconds, (B, 2)."""
        if self.numeric:
            return np.broadcast_to(np.array(self._problem.duration, dtype=np.float64), (len(contexts), 2))
        return np.asarray(self._problem.functions.durations()(contexts)[0])
