"""Records of reinforcement learning: trainings of learners and the search for their settings."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from moe_policy.reports.records import ABSENT, Absent, Record, inline, read, renamed
from moe_policy.reports.tables import Column, duration
from moe_policy.rl.algorithms import ALGORITHMS
from moe_policy.rl.common import LearnerSettings
from moe_policy.rl.training import TrainingRun
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class CurvePoint(Record):
    """One evaluation of a training, on the development set: :class:`moe_policy.rl.evaluation.Evaluation` as JSON."""

    steps: int  # decisions learnt from until then
    seconds: float  # wall time of the training until then, earlier evaluations included
    success: int  # episodes in the goal ball at the evaluation time
    reached: int  # episodes that entered the goal ball
    cost: float | None  # mean ∫L dt up to the goal ball over the successes; ``None`` without any
    score: float  # by which the best actor is chosen; lower is better
    cost_ratio: float | Absent | None = ABSENT  # Σ cost / Σ optimal cost over the successes; ``None`` without any
    mean_return: float | Absent | None = ABSENT  # mean undiscounted return
    violation: float | Absent | None = ABSENT  # mean of the maximum violation of path constraints; ``None`` without
    final_error: float | Absent | None = ABSENT  # median of ‖x − goal‖ at the evaluation time
    closest: float | Absent = ABSENT  # closest approach: median of the smallest ‖x − goal‖ of an episode


@dataclass(frozen=True, kw_only=True)
class CaseSet(Record):
    """Parameters from which policies are evaluated."""

    name: str = renamed("set")  # of the reference set
    seed: int | Absent = ABSENT  # of its draw, in records of trials that drew it themselves
    count: int  # number of parameters
    planners: int | Absent = ABSENT  # number of those from which planners are evaluated, where learners have them all


@dataclass(frozen=True, kw_only=True)
class LearnerRun(Record):
    """One run of a learner."""

    algorithm: str  # name of the learner
    settings: dict[str, object]  # of the learner; records of older settings lack some
    steps: int  # decisions learnt from
    seconds: float  # wall time, evaluations included
    best: CurvePoint  # evaluation of the chosen actor
    curve: tuple[CurvePoint, ...]  # all evaluations
    complete: bool  # whether all steps were run
    development: CaseSet  # the set of the evaluations
    provenance: Provenance  # of the run

    @classmethod
    def of(cls, run: TrainingRun, development: CaseSet, provenance: Provenance) -> Self:
        """The record of ``run``, evaluated on ``development`` and begun with ``provenance``."""
        curve = tuple(CurvePoint(**dataclasses.asdict(evaluation)) for evaluation in run.curve)
        return cls(
            algorithm=run.settings.algorithm,
            settings=dataclasses.asdict(run.settings),
            steps=curve[-1].steps,
            seconds=curve[-1].seconds,
            best=CurvePoint(**dataclasses.asdict(run.best)),
            curve=curve,
            complete=run.settings.complete(curve[-1].steps),
            development=development,
            provenance=provenance,
        )

    @property
    def learner(self) -> LearnerSettings:
        """The settings, with today's defaults for those that are not recorded."""
        known: Mapping[str, object] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in self.settings.items()
        }
        return ALGORITHMS[self.algorithm](**known)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Trial(Record):
    """A trial of the search for settings."""

    note: str  # what was tried
    run: LearnerRun = inline()  # what came of it


@dataclass(frozen=True, kw_only=True)
class Search(Record):
    """The search for the settings of a learner: ``search_<algorithm>_<env>.json``."""

    env_id: str  # id of the problem
    trials: tuple[Trial, ...]  # in the order in which they were made


#: Of each trial: its chosen actor, and how close the last one came.
TRIAL_COLUMNS: tuple[Column[Trial], ...] = (
    Column("trial", lambda trial: trial.note),
    Column("decisions", lambda trial: trial.run.steps, ","),
    Column("wall time", lambda trial: trial.run.seconds, duration),
    Column("success", lambda trial: trial.run.best.success / trial.run.development.count, ".1%"),
    Column("cost / best known", lambda trial: trial.run.best.cost_ratio, ".3f"),
    Column("mean violation, m", lambda trial: trial.run.best.violation, ".3f"),
    Column("closest approach", lambda trial: trial.run.curve[-1].closest, ".2g"),
)


@dataclass(frozen=True, kw_only=True)
class LearnerValidation(Record):
    """The chosen actor on the validation set."""

    reached: Proportion  # episodes that entered the goal ball
    success: Proportion  # episodes in the goal ball at the evaluation time
    left_box: int  # episodes that left the operating box


@dataclass(frozen=True, kw_only=True)
class LearnerTraining(Record):
    """The recorded training of a learner: ``training_<algorithm>_<env>[_seed<n>].json``."""

    env_id: str  # id of the problem
    run: LearnerRun = inline()  # the training
    validation: LearnerValidation  # of the chosen actor
    search: tuple[Trial, ...]  # the trials before it

    @property
    def seed(self) -> int:
        """Seed of the training."""
        return self.run.learner.seed


def training_file(algorithm: str, env_id: str, seed: int) -> str:
    """Name of the file of the training with ``algorithm`` and ``seed`` on the problem ``env_id``."""
    return f"training_{algorithm}_{env_id}{f'_seed{seed}' if seed else ''}.json"


def learner_trainings(folder: Path, problem: OptimalControlProblem) -> dict[str, list[LearnerTraining]]:
    """The trainings of every learner of ``problem`` whose records are in ``folder``, by algorithm, ordered by seed.

    Raises:
        ValueError: seeds of one algorithm were trained with different settings.
    """
    pattern = re.compile(rf"training_([a-z0-9-]+)_{re.escape(problem.id)}(_seed\d+)?\.json")
    found: dict[str, list[LearnerTraining]] = {}
    for path in sorted(folder.glob(f"training_*_{problem.id}*.json")):
        match = pattern.fullmatch(path.name)
        if match is None:
            continue
        training, seeds = read(path, LearnerTraining), found.setdefault(match[1], [])
        if seeds and (different := _differences(seeds[0].run.learner, training.run.learner)):
            raise ValueError(
                f"{path.name} has other settings than the seeds before it: {different}; "
                "train all seeds with the same ones, or move this record elsewhere"
            )
        seeds.append(training)
    return {name: sorted(seeds, key=lambda training: training.seed) for name, seeds in sorted(found.items())}


def _differences(one: LearnerSettings, other: LearnerSettings) -> str:
    names = [field.name for field in dataclasses.fields(one) if field.name != "seed"]
    pairs = [(name, getattr(one, name), getattr(other, name)) for name in names]
    return ", ".join(f"{name} {a} and {b}" for name, a, b in pairs if a != b)
