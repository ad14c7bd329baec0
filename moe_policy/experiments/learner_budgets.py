"""What the trainings of a reinforcement learner took, and how successful it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from moe_policy.experiments.curves import Curve
from moe_policy.experiments.learners import LearnerTraining
from moe_policy.experiments.records import ABSENT, Absent, Record
from moe_policy.rl.evaluation import Performance
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array


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

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, episodes: Episodes, optimal_costs: Array, charged: Episodes | None = None
    ) -> Self:
        """The metrics of ``episodes``.

        Args:
            problem: the problem.
            episodes: of all cases.
            optimal_costs: the best known costs of the cases, (B,).
            charged: the same cases evaluated at the goal, for the return of policies that plan; their ``episodes`` end
                with the plan.
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
        )


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
