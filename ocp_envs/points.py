"""Points at which a problem's functions are tried, and the warnings of what is found there."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

#: Number of points of each kind, and the key of the generator that draws them.
_POINTS, _KEY = 8, 20190622


@dataclass(frozen=True, eq=False)
class Points:
    """Points with ``states`` (M, nx), ``controls`` (M, nu) and ``contexts`` (M, nc), ``called`` so in messages."""

    called: str
    states: Array
    controls: Array
    contexts: Array

    def text(self, problem: OptimalControlProblem, row: int) -> str:
        """The point ``row``, in the coordinates of ``problem``, in words."""
        names = (*problem.system.state.names, *problem.system.control.names, *problem.context.names)
        values = np.concatenate([self.states[row], self.controls[row], self.contexts[row]])
        return ", ".join(f"{name} = {value:.4g}" for name, value in zip(names, values))


def points_of(problem: OptimalControlProblem) -> tuple[Points, Points, Points]:
    """The goal of ``problem`` in some contexts, initial states with the goal's control, and points of the box.

    Constants that parameters replace have their nominal values in the first context, if these lie in the box.
    """
    rng = np.random.Generator(np.random.Philox(key=_KEY))
    terminal, system = problem.terminal, problem.system
    starts, contexts = problem.start(problem.parameters.draw(rng, _POINTS))
    contexts = contexts.copy()
    for i, c in enumerate(problem.context.coordinates):
        if c.lower <= system.constants.get(c.name, np.nan) <= c.upper:
            contexts[0, i] = system.constants[c.name]
    held = np.array(terminal.controls(contexts))
    inside = Points("in the box", system.state.draw(rng, _POINTS), system.control.draw(rng, _POINTS), contexts)
    at_goal = Points("at the goal", np.array(terminal.states(contexts)), held, contexts)
    return at_goal, Points("at initial states", starts, held, contexts), inside


def warn(text: str) -> None:
    """Warn with ``text`` where a problem is declared."""
    warnings.warn(text, stacklevel=6)
