"""Records of reinforcement learning: trainings of learners and the search for their settings."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from moe_policy.experiments.records import ABSENT, Absent, Record, inline, read, renamed
from moe_policy.rl.settings import ALGORITHMS, RLSettings
from moe_policy.rl.training import TrainingRun
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class CurvePoint(Record):
    """One evaluation of a training, on the development set: :class:`moe_policy.rl.evaluation.Evaluation` as JSON.

    Args:
        steps: decisions learnt from until then.
        seconds: wall time of the training until then, earlier evaluations included.
        success: episodes in the goal ball at the evaluation time.
        reached: episodes that entered the goal ball.
        cost: mean ∫L dt up to the goal ball over the successes; ``None`` without any.
        score: by which the best actor is chosen; lower is better.
        cost_ratio: Σ cost / Σ optimal cost over the successes; ``None`` without any.
        mean_return: mean undiscounted return.
        violation: mean of the maximum violation of the path constraints; ``None`` without any.
        final_error: median of ‖x − goal‖ at the evaluation time.
    """

    steps: int
    seconds: float
    success: int
    reached: int
    cost: float | None
    score: float
    cost_ratio: float | Absent | None = ABSENT
    mean_return: float | Absent | None = ABSENT
    violation: float | Absent | None = ABSENT
    final_error: float | Absent | None = ABSENT


@dataclass(frozen=True, kw_only=True)
class CaseSet(Record):
    """Parameters from which policies are evaluated.

    Args:
        name: of the reference set.
        seed: of its draw, in records of trials that drew it themselves.
        count: number of parameters.
        planners: number of those from which planners are evaluated, where learners have them all.
    """

    name: str = renamed("set")
    seed: int | Absent = ABSENT
    count: int
    planners: int | Absent = ABSENT


@dataclass(frozen=True, kw_only=True)
class LearnerRun(Record):
    """One run of a learner.

    Args:
        algorithm: name of the learner.
        settings: of the learner; records of older settings lack some.
        steps: decisions learnt from.
        seconds: wall time, evaluations included.
        best: evaluation of the chosen actor.
        curve: all evaluations.
        complete: whether all steps were run.
        development: the set of the evaluations.
        provenance: of the run.
    """

    algorithm: str
    settings: dict[str, object]
    steps: int
    seconds: float
    best: CurvePoint
    curve: tuple[CurvePoint, ...]
    complete: bool
    development: CaseSet
    provenance: Provenance

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
            complete=curve[-1].steps >= run.settings.steps,
            development=development,
            provenance=provenance,
        )

    @property
    def learner(self) -> RLSettings:
        """The settings, with today's defaults for those that are not recorded."""
        known: Mapping[str, object] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in self.settings.items()
        }
        return ALGORITHMS[self.algorithm](**known)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Trial(Record):
    """A trial of the search for settings.

    Args:
        note: what was tried.
        run: what came of it.
    """

    note: str
    run: LearnerRun = inline()


@dataclass(frozen=True, kw_only=True)
class Search(Record):
    """The search for the settings of a learner: ``search_<algorithm>_<env>.json``.

    Args:
        env_id: id of the problem.
        trials: in the order in which they were made.
    """

    env_id: str
    trials: tuple[Trial, ...]


@dataclass(frozen=True, kw_only=True)
class LearnerValidation(Record):
    """The chosen actor on the validation set.

    Args:
        reached: episodes that entered the goal ball.
        success: episodes in the goal ball at the evaluation time.
        left_box: episodes that left the operating box.
    """

    reached: Proportion
    success: Proportion
    left_box: int


@dataclass(frozen=True, kw_only=True)
class LearnerTraining(Record):
    """The recorded training of a learner: ``training_<algorithm>_<env>[_seed<n>].json``.

    Args:
        env_id: id of the problem.
        run: the training.
        validation: of the chosen actor.
        search: the trials before it.
    """

    env_id: str
    run: LearnerRun = inline()
    validation: LearnerValidation
    search: tuple[Trial, ...]

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
    pattern = re.compile(rf"training_([a-z0-9]+)_{re.escape(problem.id)}(_seed\d+)?\.json")
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


def _differences(one: RLSettings, other: RLSettings) -> str:
    names = [field.name for field in dataclasses.fields(one) if field.name != "seed"]
    pairs = [(name, getattr(one, name), getattr(other, name)) for name in names]
    return ", ".join(f"{name} {a} and {b}" for name, a, b in pairs if a != b)
