"""Planners and learners by what they are given and what they spend: ``budgets_<env>.json`` and its table.

A learner spends environment steps, one simulated state each, ``period`` seconds apart; a planner spends what
:mod:`moe_policy.experiments.planner_budgets` counts.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Self, TypeVar

from moe_policy.experiments.learner_budgets import DevelopmentMetrics, LearnerBudget
from moe_policy.experiments.learners import CaseSet
from moe_policy.experiments.planner_budgets import GenerationEffort, PlannerBudget, PlannerRow
from moe_policy.reports.records import ABSENT, Absent, Record, inline
from moe_policy.reports.tables import Column, duration
from ocp_envs.support.provenance import Provenance

Of = TypeVar("Of", "ShippedPlanner", "Level")
#: What each side is given, word for word in every record.
GIVEN = {
    "planners": (
        "The model: dynamics, cost and constraints with their first and second derivatives, in a solver; the solution "
        "families of the optimum where clusters are custom ones; for tracking, the linearisation of the model. "
        "Instances and solutions of the training set alone; settings were chosen on the development set."
    ),
    "learners": (
        "Samples of the environment alone: features of the state and the context, rewards (scaled and, where the "
        "settings say so, shaped with the distance to the goal or reduced by a price on it), and, where these say so, "
        "many episodes that begin near the goal, and a goal ball that is larger at first. The regulator at the goal is "
        "the linear one of the planners. The best "
        "actor is chosen on the development set; the episodes of these evaluations do not count as steps, but their "
        "time is included in the wall time."
    ),
    "clones": (
        "Behaviour cloning (`bc`): decisions of the tracked optimum, from stored optimal trajectories that are flown "
        "under a disturbance; its steps are these decisions. Learners that begin with a clone (`ppo-bc`) are given it "
        "besides what learners are given; its decisions and its time are not counted in theirs."
    ),
    "steps": (
        "An environment step of a learner is one simulated state. The budget of a planner is given twice: solves × "
        "knots, the states of the solutions, and iterations of the solver × knots, the states simulated on the way to "
        "them; an iteration also takes derivatives, which no step provides."
    ),
    "wall_time": (
        "Of a learner: one process with one thread, its evaluations included. Of a planner: the generation of its "
        "data, on as many processes as `workers` says, and its training in one process. Other processes ran next to "
        "some of them, so that equal runs took different times: `seconds` has one value a seed."
    ),
}


@dataclass(frozen=True, kw_only=True)
class ShippedPlanner(Record):
    """A shipped planner on the development set."""

    name: str  # of the planner
    samples: int  # instances on which it was trained
    budget: PlannerBudget | None  # what that took; ``None`` without a record of the generation
    development: DevelopmentMetrics  # its metrics


@dataclass(frozen=True, kw_only=True)
class Level(Record):
    """A method without a budget, with which the others are compared."""

    name: str  # of the method
    cases: int  # parameters from which it was run
    development: DevelopmentMetrics  # its metrics


@dataclass(frozen=True, kw_only=True)
class BudgetRow(Record):
    """A row of the table."""

    name: str  # of the method, with the seed of a learner
    solves: int | Absent | None = ABSENT  # for the data of a planner
    states: int | Absent | None = ABSENT  # simulated states
    seconds: float | Absent | None = ABSENT  # wall time
    development: DevelopmentMetrics = inline()  # metrics


@dataclass(frozen=True, kw_only=True)
class Budgets(Record):
    """Planners and learners of one problem: ``budgets_<env>.json``."""

    env_id: str  # id of the problem
    given: dict[str, str]  # what each side is given, :data:`GIVEN`
    not_attempted: dict[str, str]  # what was not tried, and why
    development: CaseSet  # the set of all metrics but those of ``planners``
    validation: CaseSet  # the set of the metrics of ``planners``
    learners: dict[str, LearnerBudget]  # by name
    generation: GenerationEffort | None  # what it took to solve the training set; ``None`` where it is not known
    planners: tuple[PlannerRow, ...]  # over seeds and numbers of training instances, on the validation set
    shipped: tuple[ShippedPlanner, ...]  # the planners in the package
    levels: tuple[Level, ...]  # methods without a budget
    provenance: Provenance  # of the record
    rows: tuple[BudgetRow, ...] = ()  # the table

    def relative(self) -> Self:
        """The record with costs relative to the tracked optimum, as in all other tables, and with its table.

        The ratios of the record are to the optimal costs to the centre of the goal ball, since trainings keep no costs
        of single episodes. Each is divided by the ratio of the tracked optimum, whose episodes end at the edge of the
        ball, too. The result is exact for methods that succeed from all parameters.
        """
        optimum = next((level.development.cost_ratio for level in self.levels), None)
        if optimum is None:
            return self
        replaced = dataclasses.replace(
            self,
            learners={name: learner.relative(optimum) for name, learner in self.learners.items()},
            shipped=tuple(_relative(planner, optimum) for planner in self.shipped),
            levels=tuple(_relative(level, optimum) for level in self.levels),
        )
        return replaced.with_rows()

    def with_rows(self) -> Self:
        """The record with its table.

        Learners: the end of every seed's training, and the shipped actor when it was chosen. Planners: the shipped
        ones, with the states simulated by the solver for their data. Last, the methods without a budget.
        """
        rows: list[BudgetRow] = []
        for name, learner in self.learners.items():
            rows += _learner_rows(name, learner)
        rows += [_planner_row(planner) for planner in self.shipped]
        rows += [BudgetRow(name=level.name, development=level.development) for level in self.levels]
        return dataclasses.replace(self, rows=tuple(rows))


def _relative(one: Of, optimum: float) -> Of:
    return dataclasses.replace(one, development=one.development.relative(optimum))


def _learner_rows(name: str, learner: LearnerBudget) -> list[BudgetRow]:
    rows = [
        BudgetRow(
            name=f"{name}, seed {curve.seed}",
            states=curve.steps[-1],
            seconds=curve.seconds[-1],
            development=DevelopmentMetrics.last(curve),
        )
        for curve in learner.curves
    ]
    if (actor := learner.chosen) is not None:
        label = f"{name}, the shipped actor"
        rows.append(BudgetRow(name=label, states=actor.steps, seconds=actor.seconds, development=actor.development))
    return rows


def _planner_row(planner: ShippedPlanner) -> BudgetRow:
    row, budget = BudgetRow(name=planner.name, development=planner.development), planner.budget
    if budget is None:
        return dataclasses.replace(row, solves=None, states=None, seconds=None)
    return dataclasses.replace(row, solves=budget.solves, states=budget.states_of_iterations, seconds=budget.seconds)


BUDGET_COLUMNS: tuple[Column[BudgetRow], ...] = (
    Column("method", lambda row: row.name),
    Column("solves", lambda row: row.solves, ","),
    Column("simulated states", lambda row: row.states, ","),
    Column("wall time", lambda row: row.seconds, duration),
    Column("success", lambda row: row.development.success, ".1%"),
    Column("cost / optimal", lambda row: row.development.cost_ratio, ".3f"),
    Column("mean return", lambda row: row.development.mean_return, ".2f"),
    Column("mean violation, m", lambda row: row.development.violation, ".3f"),
    Column("closest approach", lambda row: row.development.closest, ".2g"),
)
