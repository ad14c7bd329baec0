"""A problem with a published optimum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ocp_envs import OptimalControlProblem


@dataclass(frozen=True, eq=False)
class Case:
    """``problem`` has the optimal cost ``optimum`` at the parameters ``p``.

    The solver begins at ``guess``, or at ``starts`` guesses. ``rel`` is the relative tolerance.
    """

    problem: OptimalControlProblem
    p: list[float]
    optimum: float
    guess: Any = None
    starts: int | None = 1
    rel: float = 1e-3
    slow: bool = False
