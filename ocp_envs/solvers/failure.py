"""Why an instance was not solved: in which phase, which constraint at which knot, how near it came, and what to try."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.reasons import Violated, most_violated, not_finite
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.kinds import AnyFloat
from ocp_envs.system import Box
from ocp_envs.trajectory import Trajectory

#: The instance itself is infeasible; the guess is not finite, or a function along it; the solver did not succeed; the
#: solver reports success, but the check of its solution fails.
Phase = Literal["instance", "guess", "solver", "check"]
#: How near a bound counts as at it, as a fraction of the box.
_AT = 1e-3
_MORE = "more guesses (starts=…), or a guess of your own (guess=…), such as the solution of a neighbouring instance"


@checked
@dataclass(frozen=True, eq=False)
class Failure:
    """Why an instance was not solved.

    Args:
        phase: where it failed: "instance" (its ends violate a constraint), "guess", "solver" or "check".
        text: what is wrong, in a sentence.
        nearest: the least infeasible point of all attempts, a trajectory of one row; NaN where none is finite.
        constraint: which constraint that point violates most; "" if unknown.
        knot: where, counted from 0; ``None`` if unknown or of no knot.
        amount: by how much, in ``unit``; NaN if unknown.
        unit: what the amount is measured in; "" for the unit of the constraint.
        advice: what to try, the likeliest first.
    """

    phase: Phase
    text: str
    nearest: Trajectory
    constraint: str = ""
    knot: int | None = None
    amount: AnyFloat = np.nan
    unit: str = ""
    advice: tuple[str, ...] = ()

    def __str__(self) -> str:
        return "\n".join([f"{self.phase}: {self.text}", *(f"- try {each}" for each in self.advice)])

    def shifted(self, turns: Array) -> Failure:
        """The same with ``turns`` (1, nx) added to the states of the least infeasible point."""
        return dataclasses.replace(self, nearest=self.nearest.shifted(turns))


def of_instance(problem: OptimalControlProblem, text: str) -> Failure:
    """The failure of an instance of ``problem`` whose ends violate a constraint, as ``text`` says."""
    advice = (
        "other parameters (ocp_envs.check counts such instances), or a goal, a box or a constraint that allows them"
    )
    return Failure("instance", text, _nothing(problem), advice=(advice,))


def explained(
    problem: OptimalControlProblem, parameters: Array, guess: Trajectory, ends: Trajectory, statuses: Sequence[int]
) -> tuple[Status, Failure]:
    """How the solves of an instance of ``problem`` with ``parameters`` (1, np) failed, and why.

    The last ones began at each ``guess`` and have ``statuses``; all attempts ended at ``ends``, perhaps more of them.
    """
    if not guess.finite.any():
        return Status.NOT_FINITE, Failure("guess", "no guess is finite", _nothing(problem), advice=(_MORE,))
    for phase, tried in (("guess", guess), ("solver", ends)):
        if reason := not_finite(problem, np.repeat(parameters, len(tried), axis=0), tried):
            return Status.NOT_FINITE, _not_finite(problem, "guess" if phase == "guess" else "solver", reason)
    status, best = Status(int(statuses[0])), most_violated(problem, np.repeat(parameters, len(ends), axis=0), ends)
    phase_of: Phase = "check" if status == Status.CHECK_FAILED else "solver"
    if best is None:
        text = f"the solver ends without a point ({status.name})"
        return status, Failure(phase_of, text, _nothing(problem), advice=(_MORE,))
    nearest = ends[best.row]
    advice = (*_of_bounds(problem, parameters, nearest), *_of_status(status, best))
    named = best.constraint, best.knot, best.amount, best.unit.removeprefix(" of ")
    return status, Failure(phase_of, best.text, nearest, *named, advice)


def _nothing(problem: OptimalControlProblem) -> Trajectory:
    return problem.unflatten(np.full((1, problem.flat_size), np.nan))


def _not_finite(problem: OptimalControlProblem, phase: Phase, reason: str) -> Failure:
    advice = (
        "a function that is finite and smooth there, such as ca.sqrt(a + 1e-6) instead of ca.sqrt(a)",
        "bounds of the states that keep guesses and plans away from there",
    )
    return Failure(phase, reason, _nothing(problem), advice=advice)


def _of_bounds(problem: OptimalControlProblem, parameters: Array, nearest: Trajectory) -> list[str]:
    """What to try where the least infeasible point lies at bounds."""
    _, contexts = problem.start(parameters)
    shortest, longest = problem.horizon.of(contexts)[0]
    advice, width = [], longest - shortest
    if width > 0 and nearest.duration[0] > longest - _AT * width:
        advice.append(f"a longer duration: the least infeasible point takes the longest, {longest:.4g} s")
    if width > 0 and nearest.duration[0] < shortest + _AT * width:
        advice.append(f"a shorter duration: the least infeasible point takes the shortest, {shortest:.4g} s")
    advice += _at_bounds(problem.planned_controls, nearest.controls[0], 0.5)
    return advice + _at_bounds(problem.planned_states, nearest.states[0, 1:], 0.0)


def _at_bounds(box: Box, values: Array, share: float) -> list[str]:
    """Wider bounds for those coordinates of ``box`` whose ``values`` (K, n) are more often at one than ``share``."""
    gap = np.minimum(values - box.lower, box.upper - values) / (box.upper - box.lower)
    at = (gap < _AT).mean(axis=0)
    return [
        f"wider bounds of {name}: the least infeasible point is at one for {fraction:.0%} of the time"
        for name, fraction in zip(box.names, at)
        if fraction > share
    ]


def _of_status(status: Status, best: Violated) -> list[str]:
    """What to try after a solve that ended with ``status`` at a point that violates ``best`` most."""
    if status == Status.INFEASIBLE and best.kind in ("clearance", "between", "mixed"):
        return ["another guess (guess=…), on another side of the constraint: no trajectory near this point meets all"]
    if status == Status.INFEASIBLE:
        return ["another guess (guess=…): no trajectory near this point meets all", "parameters nearer to the goal"]
    if status == Status.CHECK_FAILED:
        return ["more substeps, or scales of the size that the coordinates have", _MORE]
    if status in (Status.TIMED_OUT, Status.CRASHED):
        return [_MORE, "fewer knots, to see whether the problem can be solved at all"]
    return [_MORE, "ocp_envs.check(problem), which measures scales, bounds and the accuracy of the steps"]
