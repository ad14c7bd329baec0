"""How a plan is renewed: the rest of the old plan against other plans from the present state.

Candidates, in this order, are the rest of the old plan as it is tracked now; that rest after a few iterations of the
solver, which begins at the present state; and what the planner plans from there, where its parameters determine the
whole state and lie in their box. After a push, and at the beginning, the solver also makes a few iterations from what
the planner plans for the nearest parameters in the box. The model predicts the episode of each.

The cheapest that succeeds is the plan. Costs count up to the plan's end, since inside the goal ball those up to the
first entry are 0 for all. A plan of another solution family has to save a given part of the cost: what it saves in the
model may be lost to an error of either prediction, and each change costs what was spent on the old family. Where none
succeeds, the best is repaired, and then solved for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from moe_policy.checking.candidates import Candidates
from moe_policy.checking.forecast import Forecast, Predicted
from moe_policy.checking.remedies import Repair, repaired, solved
from moe_policy.checking.selection import Selected
from moe_policy.control.step import Tracking
from moe_policy.control.weights import TrackingWeights
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.parameters import BOX_TOLERANCE
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.improvement import improve
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.checks import check_number, check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: The source of a plan that is the rest of the old one.
_OLD = -1
#: How far a state may be from that of the parameters that are read off it, in scales.
_SAME = 1e-6


@checked
@dataclass(frozen=True)
class Renewal:
    """How plans are renewed.

    Args:
        iterations: of the solver from the rest of the old plan; ``None`` until it converges, 0 for none.
        margin: what the path constraints have to be at least at the knots, in their unit.
        switch: part of the cost that a plan of another solution family has to save. With the default, the families
            change as often under pushes as those of the restarted solver; from 0.02 to 0.1 the costs are the same.
        commit: seconds before its end from which a plan is checked in each control step, and kept as long as the model
            predicts that it succeeds.
        surprise: how far a state has to be from the one that the model predicts from the last control step, in scales
            of its coordinates, for the plan to be renewed at once.
        rounds: of repair, with as many iterations each, where no plan succeeds in the model; then it is solved for.

    Raises:
        TypeError, ValueError: no numbers, or negative ones.
    """

    iterations: int | None = 5
    margin: float = 0.0
    switch: float = 0.05
    commit: float = 0.5
    surprise: float = 0.05
    rounds: int = 1

    def __post_init__(self) -> None:
        for name in ("iterations", "rounds"):
            if (value := getattr(self, name)) is not None:
                check_whole(name, value, 0)
        for name in ("margin", "switch", "commit", "surprise"):
            check_number(name, getattr(self, name))
            if getattr(self, name) < 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class Decided(Batch):
    """The ``plan`` of each of B rows; whether it is ``new``, and whether its family ``flipped``, (B,) each."""

    plan: Trajectory
    new: Bools
    flipped: Bools


def _total(predicted: Predicted) -> Predicted:
    """What is ``predicted``, with costs up to the plan's end."""
    return replace(predicted, cost=predicted.total)


class Renewer:
    """Renews plans of ``problem``, which are tracked with ``weights`` in control steps of ``dt`` seconds.

    New ones are made by the ``candidates``, if any, and by the solver, as ``renewal`` says.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        candidates: Candidates | None,
        renewal: Renewal,
        dt: float,
        weights: TrackingWeights | None,
    ) -> None:
        self.problem, self.renewal = problem, renewal
        self._rest_problem, self._candidates = problem.from_any_state, candidates
        self._forecast = Forecast(self._rest_problem, dt, weights)
        self._dt = dt

    def __call__(self, states: Array, contexts: Array, old: Tracking, rest: Trajectory, surprised: Bools) -> Decided:
        """The plans of B rows from ``states`` (B, nx) in ``contexts`` (B, nc), ``surprised`` (B,) or not.

        Until now the plans ``old`` are tracked, whose clocks are 0; ``rest`` are the same on the grid of a plan.
        """
        p, turns = self._rest_problem.in_one_turn(np.concatenate([states, contexts], axis=1))
        rest = rest.shifted(-turns)
        size, renewal = len(p), self.renewal
        kept = _total(self._forecast.continued(states, contexts, old))
        best = Selected(rest, kept, np.zeros(size, np.int64), np.full(size, _OLD))
        committed = kept.success & (old.schedule.plan_end <= renewal.commit + self._dt / 2)
        families = self._families(p, rest)
        if len(rows := np.flatnonzero(~committed)):
            best = best.replaced_at(rows, self._renewed(p[rows], best[rows], families[rows], surprised[rows]))
        new = best.source != _OLD
        flipped = new & (self._families(p, best.plan) != families)
        return Decided(best.plan.shifted(turns), new, flipped)

    def _renewed(self, p: Array, old: Selected, families: Ints, surprised: Bools) -> Selected:
        """The best plans for ``p`` (B, nx + nc), where the ``old`` ones have the ``families`` (B,).

        Where the states ``surprised`` (B,), more is tried.
        """
        radius, every, best = self.problem.goal.radius, np.arange(len(p)), old
        guesses, exact = self._planned(p)
        tried = [self._where(exact, plan[exact]) for plan in guesses if exact.any()]
        if self.renewal.iterations != 0:
            tried.insert(0, self._improved(p, old.plan))
            if surprised.any():
                tried += [self._where(surprised, self._improved(p[surprised], plan[surprised])) for plan in guesses]
        for source, plan in enumerate(tried):
            predicted = self._penalised(p, plan, families)
            best = best.improved(
                every, Selected(plan, predicted, np.zeros(len(p), np.int64), every * 0 + source), radius
            )
        return self._rescued(p, best, [old.plan, *guesses])

    def _improved(self, p: Array, plans: Trajectory) -> Trajectory:
        """The ``plans`` for ``p`` (B, nx + nc) after the iterations of the solver."""
        return improve(self._rest_problem, p, plans, self.renewal.iterations, self.renewal.margin).trajectory

    def _where(self, rows: Bools, plans: Trajectory) -> Trajectory:
        """The ``plans`` of the ``rows`` of a mask (B,), and NaN in the others."""
        return self.problem.unflatten(np.full((len(rows), self.problem.flat_size), np.nan)).replaced(rows, plans)

    def _penalised(self, p: Array, plan: Trajectory, families: Ints) -> Predicted:
        """What is predicted of each ``plan``; one of another family counts as dearer."""
        predicted = _total(self._forecast(p, plan))
        other = self._families(p, plan) != families
        return replace(predicted, cost=np.where(other, (1 + self.renewal.switch) * predicted.cost, predicted.cost))

    def _rescued(self, p: Array, best: Selected, guesses: Sequence[Trajectory]) -> Selected:
        """The plans of ``best``; those that fail are repaired, and where that fails solved for from ``guesses``."""
        failing, renewal = ~best.predicted.success, self.renewal
        if failing.any():  # a state inside a constraint cannot be helped, and its solves take long
            failing[list(infeasible_rows(self._rest_problem, p))] = False
        rows = np.flatnonzero(failing)
        if len(rows) and renewal.rounds:
            repair = Repair(renewal.iterations or 10, renewal.rounds, renewal.margin)
            found, margin = repaired(self._forecast, self._rest_problem, p[rows], best[rows], repair)
            found = solved(
                self._forecast,
                self._rest_problem,
                p[rows],
                [guess[rows] for guess in guesses],
                margin,
                found,
                last_resort=False,
            )
            changed = found.how != best.how[rows]
            best = best.replaced_at(rows, replace(found, source=np.where(changed, 0, found.source)))
        return best

    def _planned(self, p: Array) -> tuple[Sequence[Trajectory], Bools]:
        """What the planner plans for the parameters in its box that are nearest to ``p`` (B, nx + nc).

        These are several batches of B plans, and where they begin at the states of ``p``, (B,).
        """
        if self._candidates is None:
            return (), np.zeros(len(p), bool)
        planned_for, (states, contexts) = self._candidates.problem, self._rest_problem.start(p)
        own, box = planned_for.parameters_of(states, contexts), planned_for.parameters
        apart = self.problem.system.difference(planned_for.start(own)[0], states) / self.problem.system.state.scale
        exact = (np.abs(apart) < _SAME).all(axis=1) & box.contains(own, BOX_TOLERANCE)
        return self._candidates(np.clip(own, box.lower, box.upper))[1], exact

    def _families(self, p: Array, plans: Trajectory) -> Ints:
        """The solution family of each of B ``plans`` for ``p`` (B, nx + nc), 0 for one that is not finite."""
        problem, rows, families = self.problem, plans.finite, np.zeros(len(p), np.int64)
        if len(problem.modes) > 1 and rows.any():
            own = problem.parameters_of(*self._rest_problem.start(p[rows]))
            unknown = np.zeros((int(rows.sum()), problem.knots, problem.n_clearances))
            families[rows] = problem.modes.of(problem, own, plans[rows], unknown)
        return families
