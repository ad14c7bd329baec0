"""What is done about plans that fail in the model: a few iterations of the solver, or whole solves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from moe_policy.checking.forecast import Forecast
from moe_policy.checking.selection import Selected, cheapest
from moe_policy.checking.verdict import HOW
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import path_violation
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.improvement import improve, knot_margins
from ocp_envs.solvers.solver import lent_solvers
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.checks import check_number, check_whole
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: How much a margin grows, as a multiple of the depth in the constraint, and at least; and the violation at the knots
#: below which the plan itself is clear.
_FACTOR, _LEAST, _SETTLED = 1.5, 0.01, 1e-3


@checked
@dataclass(frozen=True)
class Repair:
    """How plans are repaired.

    Args:
        iterations: of the solver in each round.
        rounds: each begins where the last one ended, as long as the plan fails; 0 for no repair.
        margin: what the path constraints have to be at least at the knots in the first round, in their unit. It grows
            with the depth by which the tracked path enters them between knots.

    Raises:
        TypeError, ValueError: no numbers, or out of their range.
    """

    iterations: int = 10
    rounds: int = 3
    margin: float = 0.0

    def __post_init__(self) -> None:
        check_whole("iterations", self.iterations)
        check_whole("rounds", self.rounds, 0)
        check_number("margin", self.margin)
        if self.margin < 0:
            raise ValueError(f"margin: expected at least 0, got {self.margin}")


def repaired(
    forecast: Forecast, model: OptimalControlProblem, parameters: Array, failing: Selected, repair: Repair
) -> tuple[Selected, Array]:
    """The plans of ``failing``, B of them, improved as ``repair`` says until their forecast succeeds.

    Args:
        forecast: predicts episodes.
        model: whose nonlinear program is solved.
        parameters: of the instances, (B, np).
        failing: the plans.
        repair: how.

    Returns:
        the best plan of each instance, and the margin (B,) that it needs.
    """
    radius, best, plan = model.goal.radius, failing, failing.plan
    margin = np.full(len(failing), repair.margin)
    for _ in range(repair.rounds):
        rows = np.flatnonzero(~best.predicted.success)
        if not len(rows):
            break
        p = parameters[rows]
        plan = plan.replaced_at(rows, improve(model, p, plan[rows], repair.iterations, margin[rows]).trajectory)
        predicted = forecast(p, plan[rows])
        new = Selected(plan[rows], predicted, np.full(len(rows), HOW.index("repaired")), best.source[rows])
        best = best.improved(rows, new, radius)
        margin[rows] += _growth(model, p, plan[rows], predicted.clearance)
    return best, margin


def _growth(model: OptimalControlProblem, parameters: Array, plan: Trajectory, clearance: Array) -> Array:
    """By how much margins grow for the next round, (B,), where the tracked paths have the smallest ``clearance``.

    They do where the plan is clear at its knots and the path is not; elsewhere the plan needs more iterations.
    """
    depth = np.where(np.isfinite(clearance), np.maximum(-clearance, 0.0), 0.0)
    settled = path_violation(model, plan, model.start(parameters)[1]) < _SETTLED
    return np.where(settled & (depth > 0), np.maximum(_FACTOR * depth, _LEAST), 0.0)


def solved(
    forecast: Forecast,
    model: OptimalControlProblem,
    parameters: Array,
    guesses: Sequence[Trajectory],
    margin: Array,
    failing: Selected,
    last_resort: bool = True,
) -> Selected:
    """The plans of ``failing``, B of them, or solutions from ``guesses`` with a better forecast.

    Args:
        forecast: predicts episodes.
        model: whose nonlinear program is solved.
        parameters: of the instances, (B, np).
        guesses: batches of B plans from which it is solved.
        margin: on the path constraints, (B,).
        failing: the plans.
        last_resort: whether the fallback solver is used where nothing else helps.
    """
    best = failing
    # The fallback solver takes seconds where a problem is large: from the likeliest plan alone.
    attempts = ((guesses, False), (guesses[:1], True)) if last_resort else ((guesses, False),)
    for tried, fallback in attempts:
        rows = np.flatnonzero(~best.predicted.success)
        if len(rows):
            found = [guess[rows] for guess in tried]
            best = _solved_from(forecast, model, parameters, rows, found, margin[rows], best, fallback)
    return best


def _solved_from(
    forecast: Forecast,
    model: OptimalControlProblem,
    parameters: Array,
    rows: Ints,
    guesses: Sequence[Trajectory],
    margin: Array,
    best: Selected,
    last_resort: bool,
) -> Selected:
    """The plans of ``best``, or better solutions for ``rows`` (M,) from the ``guesses``, batches of M plans."""
    count = len(guesses)
    row, p = np.tile(rows, count), np.tile(parameters[rows], (count, 1))
    with lent_solvers(model).one() as solver:
        solutions, _ = solver.attempts(
            p,
            Trajectory.concatenate(guesses),
            np.full(len(p), NEAREST_WINDING),
            retry_with_fallback=last_resort,
            rescue=last_resort,
            margins=np.tile(knot_margins(model, parameters[rows], margin), (count, 1)),
        )
    found = np.flatnonzero(solutions.solved)
    if not len(found):
        return best
    predicted = forecast(p[found], solutions.trajectory[found])
    chosen = cheapest(predicted, row[found], model.goal.radius)
    wins = row[found][chosen]
    how = np.full(len(wins), HOW.index("solved"))
    new = Selected(solutions.trajectory[found][chosen], predicted[chosen], how, best.source[wins])
    return best.improved(wins, new, model.goal.radius)
