"""Records of trainings that nobody ran."""

import dataclasses

from moe_policy.experiments.learners import (
    CaseSet,
    CurvePoint,
    LearnerRun,
    LearnerTraining,
    LearnerValidation,
    training_file,
)
from moe_policy.reports.records import write
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.support.provenance import provenance


def point(steps, success, **more):
    """An evaluation of the first records, which kept neither ratio nor return."""
    return CurvePoint(steps=steps, seconds=steps / 50, success=success, reached=success, cost=None, score=1.0, **more)


def training(settings, successes, env_id="PendulumSwingup-v0", **more):
    """A training evaluated every 100 steps from 50 parameters, with so many successes; ``more`` are of its run."""
    curve = tuple(point(100 * (i + 1), success) for i, success in enumerate(successes))
    run = LearnerRun(
        algorithm=settings.algorithm,
        settings=dataclasses.asdict(settings),
        steps=curve[-1].steps,
        seconds=curve[-1].seconds,
        best=curve[-1],
        curve=curve,
        complete=True,
        development=CaseSet(name="development", count=50),
        provenance=provenance(),
    )
    found = Proportion(successes[-1], 50)
    validation = LearnerValidation(reached=found, success=found, left_box=0)
    return LearnerTraining(env_id=env_id, run=dataclasses.replace(run, **more), validation=validation, search=())


def keep(folder, training):
    """Write ``training`` into ``folder`` under its name."""
    write(folder / training_file(training.run.algorithm, training.env_id, training.seed), training)
