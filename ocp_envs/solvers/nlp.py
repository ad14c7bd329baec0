"""One nonlinear program, solved many times: what a solver is asked, and what it answers."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked


class Status(enum.IntEnum):
    """How a solve ended; stored in databases as int8."""

    EMPTY = 0  #: not tried, or no such solution family
    SOLVED = 1
    NOT_CONVERGED = 2  #: the tolerance was not reached within the iterations
    TIMED_OUT = 3  #: both solvers had to be killed, the last one for taking too long
    CRASHED = 4  #: the process of the last solver died
    CHECK_FAILED = 5  #: the solver reports success, but the independent check fails
    INFEASIBLE = 6  #: an end violates a constraint, or IPOPT found that none of the nearby trajectories meets all
    NOT_FINITE = 7  #: the guess, or a value or derivative that the solver met, is NaN or infinite


PRIMARIES = ("fatrop", "riccati", "ipopt")


@checked
@dataclass(frozen=True)
class SolverSettings:
    """Settings of a solve.

    Args:
        primary: "fatrop", "riccati" (the method of :mod:`ocp_envs.solvers.interior`, then fatrop), or "ipopt"; the
            fallback is IPOPT, and fatrop that of IPOPT.
        tolerance: scaled optimality tolerance of either solver.
        max_iterations, fallback_iterations: limits of an attempt of the primary and of the fallback solver.
        hang_factor, hang_floor: an attempt of the primary solver counts as hung after the larger of ``hang_factor`` ×
            the running median time of a solve and ``hang_floor`` seconds of processor time.
    """

    primary: str = "fatrop"
    tolerance: float = 1e-6
    max_iterations: int = 150
    fallback_iterations: int = 200
    hang_factor: float = 100.0
    hang_floor: float = 5.0

    def __post_init__(self) -> None:
        if self.primary not in PRIMARIES:
            raise ValueError(f"primary must be one of {', '.join(PRIMARIES)}, got {self.primary!r}")
        positive = (self.tolerance, self.max_iterations, self.fallback_iterations, self.hang_factor, self.hang_floor)
        if not all(value > 0 for value in positive):
            raise ValueError(f"tolerance, limits and times must be positive, got {self}")

    @property
    def fallback(self) -> str:
        """The solver that is not the primary one."""
        return "fatrop" if self.primary == "ipopt" else "ipopt"


class Task(NamedTuple):
    """One solve in scaled variables, from ``guess`` w (nw,), for ``parameter`` [x_0; s] (nx + nc,).

    The goal state has the index ``target``. Where the primary solver does not converge, the fallback continues if
    ``retry_with_fallback``; where it breaks down, hangs or crashes, the fallback solves the task if ``rescue``.
    With a number of ``iterations`` the primary solver makes so many at most, in one attempt. The clearances at the
    knots k ≥ 1 are at least the ``margin`` (N − 1,), in their unit, by default 0.
    """

    guess: Array
    parameter: Array
    target: int
    retry_with_fallback: bool = True
    rescue: bool = True
    iterations: int | None = None
    margin: Array | None = None


class Result(NamedTuple):
    """How one solve ended: ``status``, ``iterations`` of both solvers, use of the ``fallback``, time in ``seconds``.

    The scaled variables ``w`` (nw,), the ``cost`` J and the ``multipliers`` (N − 1, nh) of the clearances at the knots
    k ≥ 1 are meaningless unless SOLVED.
    """

    status: Status
    w: Array
    cost: float
    multipliers: Array
    iterations: int
    fallback: bool
    seconds: float

    @classmethod
    def failed(cls, status: Status, transcription: Transcription, fallback: bool, seconds: float) -> Result:
        """The result of a solve of ``transcription`` of which only how it ended is known.

        This is its ``status``, whether the ``fallback`` solver was used, and its ``seconds``.
        """
        w, multipliers = (
            np.full(transcription.lower.shape, np.nan),
            np.full(transcription.rows.clearances.shape, np.nan),
        )
        return cls(status, w, np.nan, multipliers, 0, fallback, seconds)


class Outcome(enum.Enum):
    """How one run of one solver ended."""

    CONVERGED = enum.auto()
    STUCK = enum.auto()  #: at a finite point, for want of progress or of iterations
    BROKE_DOWN = enum.auto()  #: an exception, or values that are not finite
