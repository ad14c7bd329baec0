"""What the trainings of a reinforcement learner took, how successful it was, and its training curves over seeds.

The median over n seeds is drawn with their minimum and maximum (:class:`moe_policy.rollouts.intervals.Spread` says how
often these enclose the median of all seeds).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.experiments.learners import LearnerRun, LearnerTraining
from moe_policy.reports.records import ABSENT, Absent, Record, present
from moe_policy.rl.evaluation import Performance
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Curve(Record):
    """A training curve: one value for each evaluation on the development set, ``None`` where it was not kept."""

    seed: int  # of the training
    steps: tuple[int, ...]  # decisions learnt from
    seconds: tuple[float, ...]  # wall time of the training
    success: tuple[float, ...]  # fraction of the episodes in the goal ball at the evaluation time
    cost_ratio: tuple[float | None, ...]  # Σ cost / Σ optimal cost over the successes
    mean_return: tuple[float | None, ...]  # mean undiscounted return
    violation: tuple[float | None, ...]  # mean of the maximum violation of the path constraints
    closest: tuple[float | None, ...] | Absent = ABSENT  # closest approach: median smallest ‖x − goal‖ of an episode

    @classmethod
    def of(cls, run: LearnerRun) -> Self:
        """The curve of ``run``."""
        return cls(
            seed=run.learner.seed,
            steps=tuple(point.steps for point in run.curve),
            seconds=tuple(point.seconds for point in run.curve),
            success=tuple(point.success / run.development.count for point in run.curve),
            cost_ratio=tuple(present(point.cost_ratio) for point in run.curve),
            mean_return=tuple(present(point.mean_return) for point in run.curve),
            violation=tuple(present(point.violation) for point in run.curve),
            closest=tuple(present(point.closest) for point in run.curve),
        )

    def relative(self, optimum: float) -> Self:
        """The curve with cost ratios in units of that of the ``optimum``."""
        return replace(self, cost_ratio=tuple(None if ratio is None else ratio / optimum for ratio in self.cost_ratio))


@dataclass(frozen=True, kw_only=True)
class DevelopmentMetrics(Record):
    """Metrics on the development set, of any method; some are not kept along a training curve."""

    success: float  # fraction of the episodes in the goal ball at the evaluation time
    reached: int | Absent = ABSENT  # episodes that entered the goal ball
    cost: float | Absent | None = ABSENT  # mean ∫L dt up to the goal ball over the successes; ``None`` without any
    score: float | Absent = ABSENT  # by which actors are chosen; lower is better
    cost_ratio: float | None  # Σ cost / Σ optimal cost over the successes; ``None`` without any
    mean_return: float | None  # mean undiscounted return as the environment charges it
    violation: float | None  # mean of the maximum violation of the path constraints, metres; ``None`` without any
    final_error: float | Absent = ABSENT  # median of ‖x − goal‖ at the evaluation time
    closest: float | Absent | None = ABSENT  # closest approach: median smallest ‖x − goal‖ of an episode

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, episodes: Episodes, optimal_costs: Array, charged: Episodes | None = None
    ) -> Self:
        """The metrics of ``episodes`` of all cases, whose best known costs are ``optimal_costs`` (B,).

        The returns of policies that plan are those of ``charged``, the same cases evaluated at the goal, because
        their ``episodes`` end with the plan.
        """
        found = Performance.of(problem, episodes, optimal_costs)
        returns = found if charged is None else Performance.of(problem, charged)
        changed = {"success": found.success / len(episodes), "mean_return": returns.mean_return}
        return cls(**vars(found) | changed)

    @classmethod
    def last(cls, curve: Curve) -> Self:
        """The metrics of the last evaluation of ``curve``."""
        return cls(
            success=curve.success[-1],
            cost_ratio=curve.cost_ratio[-1],
            mean_return=curve.mean_return[-1],
            violation=curve.violation[-1],
            closest=None if isinstance(curve.closest, Absent) else curve.closest[-1],
        )

    def relative(self, optimum: float) -> Self:
        """The metrics with a cost ratio in units of that of the ``optimum``."""
        return self if self.cost_ratio is None else replace(self, cost_ratio=self.cost_ratio / optimum)


@dataclass(frozen=True, kw_only=True)
class ChosenActor(Record):
    """The shipped actor of a learner."""

    steps: int  # decisions learnt from when it was chosen
    seconds: float | None  # wall time of the training until then; ``None`` where its curve has no such evaluation
    development: DevelopmentMetrics  # its metrics


@dataclass(frozen=True, kw_only=True)
class LearnerBudget(Record):
    """The seeds of a learner: what they spent, and how successful they were."""

    settings: dict[str, object]  # common to the seeds
    seeds: tuple[int, ...]  # of the trainings
    steps: tuple[int, ...]  # decisions, one a seed
    simulated_seconds: tuple[float, ...]  # simulated time, one a seed
    seconds: tuple[float, ...]  # wall time, one a seed
    trials_before: int  # trials of the search for the settings
    steps_of_trials: int  # decisions in all trials
    validation_success: Spread  # fraction of successes of the chosen actors on the validation set
    curves: tuple[Curve, ...]  # on the development set, one a seed
    chosen: ChosenActor | None  # the shipped actor; ``None`` where none is shipped

    @classmethod
    def of(cls, trainings: Sequence[LearnerTraining], chosen: ChosenActor | None = None) -> Self:
        """The budget of the seeds ``trainings`` of one learner, with the ``chosen`` actor of the first."""
        runs, search = [training.run for training in trainings], trainings[0].search
        return cls(
            settings={key: value for key, value in runs[0].settings.items() if key != "seed"},
            seeds=tuple(training.seed for training in trainings),
            steps=tuple(run.steps for run in runs),
            simulated_seconds=tuple(run.steps * run.learner.period for run in runs),
            seconds=tuple(run.seconds for run in runs),
            trials_before=len(search),
            steps_of_trials=sum(trial.run.steps for trial in search),
            validation_success=Spread.of((t.validation.success.fraction for t in trainings), (0, 1)),
            curves=tuple(Curve.of(run) for run in runs),
            chosen=chosen,
        )

    def relative(self, optimum: float) -> Self:
        """The budget with cost ratios in units of that of the ``optimum``."""
        chosen = self.chosen and replace(self.chosen, development=self.chosen.development.relative(optimum))
        return replace(self, curves=tuple(curve.relative(optimum) for curve in self.curves), chosen=chosen)


def over_seeds(curves: Iterable[tuple[Sequence[float], Sequence[float | None]]]) -> tuple[Array, Array]:
    """All seeds' ``curves``, (where evaluated, values), at common points: (points (G,), values (S, G)).

    Between evaluations curves are interpolated linearly; after its last evaluation a curve is extended with its final
    value. The points are those of the seed with the most evaluations, from the first one that all seeds have reached.
    A seed has NaN where an evaluation has no value; seeds without any value are left out.
    """
    sides = [(np.array(at, float), np.array(values, float)) for at, values in curves]  # None becomes NaN
    sides = [(at, values) for at, values in sides if np.isfinite(values).any()]
    if not sides:
        return np.empty(0), np.empty((0, 0))
    begun, last = max(at[0] for at, _ in sides), max(at[-1] for at, _ in sides)
    most = max(len(at) for at, _ in sides)
    points = np.unique(np.concatenate([at for at, _ in sides if len(at) == most]))
    points = np.append(points[(points >= begun) & (points < last)], last)
    return points, np.array([np.interp(points, at, values) for at, values in sides])


def band(values: ArrayLike) -> Array:
    """Minimum, median and maximum over the seeds that have a value at each of G points: values (S, G) → (3, G)."""
    table = np.asarray(values, dtype=np.float64)
    result = np.full((3, table.shape[1]), np.nan)
    for i, column in enumerate(table.T):
        known = column[np.isfinite(column)]
        if len(known):
            result[:, i] = known.min(), np.median(known), known.max()
    return result
