"""Control steps: how long they may be, and in how many Runge-Kutta steps they are simulated and linearised."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ocp_envs.support import fields
from ocp_envs.support.clock import count_steps

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

#: Runge-Kutta steps in one control step: they become one expression, which takes seconds to make beyond that.
MOST_SUBSTEPS = 100


def checked_dt(problem: OptimalControlProblem, dt: object) -> float:
    """``dt`` as the length of a control step of ``problem``, seconds.

    Raises:
        TypeError: no number.
        ValueError: not positive and finite, or longer than the longest plan.
    """
    seconds = fields.real(problem.id, "dt", dt)
    if not 0 < seconds < math.inf:
        raise ValueError(f"{problem.id}: dt must be a positive number of seconds, got {dt}")
    if seconds > problem.horizon.longest:
        raise ValueError(
            f"{problem.id}: dt must be at most the longest duration of a plan, {problem.horizon.longest:g} s, got "
            f"{seconds:g}; dt is in seconds"
        )
    return seconds


def runge_kutta_steps(problem: OptimalControlProblem, dt: object, substeps: int | None = None) -> int:
    """Number of Runge-Kutta steps in a control step of ``dt`` seconds of ``problem``.

    By default as many as keep each below the ``longest_substep`` of the problem; else ``substeps``.

    Raises:
        TypeError: no numbers.
        ValueError: a ``dt`` that :func:`checked_dt` refuses, fewer than one Runge-Kutta step, or more than
            :data:`MOST_SUBSTEPS`.
    """
    seconds = checked_dt(problem, dt)
    if substeps is not None:
        if (count := fields.whole(problem.id, "substeps", substeps, 1)) > MOST_SUBSTEPS:
            raise ValueError(f"{problem.id}: substeps must be at most {MOST_SUBSTEPS}, got {substeps}")
        return count
    if seconds / problem.longest_substep > MOST_SUBSTEPS + 0.5:
        raise ValueError(
            f"{problem.id}: a control step of dt = {seconds:g} s takes more than {MOST_SUBSTEPS} Runge-Kutta steps, as "
            f"longest_substep = {problem.longest_substep:g} s; dt is in seconds: shorten it, or declare a larger "
            "longest_substep"
        )
    return max(1, int(count_steps(seconds, problem.longest_substep)))
