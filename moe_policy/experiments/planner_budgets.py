"""What the data and the training of planners took, and how successful the planners were.

A planner's budget consists of solves of the optimal control problem. Counted in simulated states, N knots each, it is

    states_of_solutions  = solves × N                       the states of the solutions
    states_of_iterations = iterations of the solver × N     the states simulated on the way to them

The second one compares fairly with the environment steps of a learner, except that an iteration also takes first and
second derivatives of the dynamics, which no simulator provides. A planner trained on n of M solved instances is charged
n/M of what all of them took.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from moe_policy.experiments.data_report import DataReport
from moe_policy.experiments.generation import Generation
from moe_policy.experiments.seeds import TrainingRow
from moe_policy.reports.records import ABSENT, Absent, Record, inline, present, read
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problem import OptimalControlProblem


@dataclass(frozen=True, kw_only=True)
class GenerationEffort(Record):
    """What it took to solve the training set, from the record of its generation or, without times, of the data."""

    problems: int  # solved instances
    solves: int  # attempts
    iterations: int  # of the solver in all attempts
    seconds: float | Absent = ABSENT  # wall time
    resumed_from: int | Absent = ABSENT  # instances that earlier calls had solved, whose time is not included
    workers: int | Absent = ABSENT  # processes
    rest: dict[str, object] = inline()  # what else the record says

    @classmethod
    def read(cls, folder: Path, problem: OptimalControlProblem) -> Self | None:
        """The effort from ``generation_<env>.json`` in ``folder``, or else ``data_<env>.json``; ``None`` if none."""
        generation, data = (folder / f"{name}_{problem.id}.json" for name in ("generation", "data"))
        splits: Mapping[str, Record] = read(generation, Generation, Generation(splits={})).splits
        if "training" not in splits and data.exists():
            splits = read(data, DataReport).splits
        return cls.from_json(splits["training"].to_json()) if "training" in splits else None


@dataclass(frozen=True, kw_only=True)
class PlannerBudget(Record):
    """What a planner's data and training took."""

    samples: int  # instances on which it was trained
    knots: int  # N
    solves: int  # of these instances
    iterations: int  # of the solver for these instances
    generation_seconds: float | None  # wall time of the generation; ``None`` where no record has it
    workers: int  # processes of the generation
    #: whether values are a fraction of those of a larger set, or extrapolated to the unrecorded part of an interrupted
    #: generation
    estimated: bool
    training_seconds: tuple[float, ...]  # wall time of the training, one a seed
    states_of_solutions: int  # solves × N
    states_of_iterations: int  # iterations × N
    seconds: float | None  # wall time of the generation and median of the training; ``None`` if one is unknown

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, effort: GenerationEffort, samples: int, training_seconds: Sequence[float]
    ) -> Self:
        """The budget of a planner trained on ``samples`` instances of the set that took ``effort``, one time a seed.

        Raises:
            ValueError: more samples than instances were solved.
        """
        problems, begun = effort.problems, present(effort.resumed_from) or 0
        if not 0 < samples <= problems:
            raise ValueError(
                f"{problem.id}: expected 1 to {problems} samples, as many as instances were solved, got {samples}; "
                "make the records of data and training from the same database"
            )
        fraction, generation = samples / problems, present(effort.seconds)
        if generation is not None:
            generation = generation * fraction * problems / (problems - begun) if begun < problems else None
        solves, iterations = round(effort.solves * fraction), round(effort.iterations * fraction)
        return cls(
            samples=samples,
            knots=problem.knots,
            solves=solves,
            iterations=iterations,
            generation_seconds=generation,
            workers=present(effort.workers) or 1,
            estimated=fraction < 1 or begun > 0,
            training_seconds=tuple(training_seconds),
            states_of_solutions=solves * problem.knots,
            states_of_iterations=iterations * problem.knots,
            seconds=None if generation is None else generation + float(np.median(training_seconds)),
        )


@dataclass(frozen=True, kw_only=True)
class PlannerRow(Record):
    """The seeds of a planner trained on some number of instances, on the validation set."""

    name: str  # of the planner
    samples: int  # instances on which it was trained
    budget: PlannerBudget | None  # what that took; ``None`` without a record of the generation
    validation_success: Spread  # fraction of successes
    validation_violation: Spread | None  # mean of the maximum violation of path constraints, metres, if any


def planner_rows(
    problem: OptimalControlProblem,
    trained: Sequence[TrainingRow],
    effort: GenerationEffort | None,
    names: Sequence[str],
    cases: int,
) -> tuple[PlannerRow, ...]:
    """One row for each of the planners ``names`` and number of training instances, in this order.

    The first planner of a name and number counts. There are ``cases`` validation cases.
    """
    rows: dict[tuple[int, int], PlannerRow] = {}
    for row in trained:
        if row.name not in names or (names.index(row.name), row.samples) in rows:
            continue
        budget = None if effort is None else PlannerBudget.of(problem, effort, row.samples, row.training_seconds)
        violation = [value for value in present(row.violation) or () if value is not None]
        rows[names.index(row.name), row.samples] = PlannerRow(
            name=row.name,
            samples=row.samples,
            budget=budget,
            validation_success=Spread.of((count / cases for count in row.success), (0, 1)),
            validation_violation=Spread.of(violation) if violation else None,
        )
    return tuple(rows[key] for key in sorted(rows))
