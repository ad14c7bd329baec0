"""Trained networks over several training seeds: a record for each model, and a row for all seeds of one kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from moe_policy.experiments import comparison
from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.figures.details import Details, DiscontinuityCase
from moe_policy.learning.training import SHARED
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import ABSENT, Absent, Record, Scalar, inline, present, renamed
from moe_policy.score.method import Method
from ocp_envs.data.samples import Samples
from ocp_envs.support.provenance import Provenance

Settings = dict[str, Scalar]


@dataclass(frozen=True, kw_only=True)
class Training(Record):
    """How a network was trained."""

    seed: int  # of the training
    samples: int  # number of training instances
    test_error: float  # smooth L1 loss on the test split
    training_seconds: float  # duration
    peak_memory_gb: float | Absent | None = ABSENT  # of the process, 2³⁰ bytes; ``None`` where it was not measured
    gate_accuracy: float | Absent | None = ABSENT  # of a mixture on the test split; ``None`` for a single network
    part_test_errors: tuple[float, ...] | Absent = ABSENT  # test loss of each expert, or of the single network
    cluster_sizes: tuple[int, ...] | Absent | None = ABSENT  # samples in each cluster; ``None`` for a single network

    @classmethod
    def of(cls, planner: NetworkPlanner) -> Training:
        """The training of ``planner``."""
        training = planner.details["training"]
        parts = training["parts"]
        clusters = planner.details.get("clusters", {}).get("sizes")
        return cls(
            seed=planner.details["seed"],
            samples=planner.details["samples"],
            test_error=training["test_error"],
            training_seconds=training["seconds"],
            peak_memory_gb=training.get("peak_memory_gb"),
            gate_accuracy=next((part["accuracy"] for part in parts if part["accuracy"] is not None), None),
            part_test_errors=tuple(
                part["test_loss"] for part in parts if part["accuracy"] is None and not part["name"].startswith(SHARED)
            ),
            cluster_sizes=None if clusters is None else tuple(clusters),
        )


@dataclass(frozen=True, kw_only=True)
class Model(Record):
    """A trained network on the validation set."""

    training: Training = inline()  # how it was trained
    success: int  # number of successful rollouts
    success_at_plan_end: int  # number of rollouts in the goal ball at the plan's end
    reached: int  # number of rollouts that enter the goal ball
    violation: float | None  # mean violation on the whole path, metres; ``None`` without path constraints
    knot_violation: float | None  # the same at the knots
    #: number of successes within each tolerance of the path constraints, by the tolerance; ``None`` without constraints
    success_clear: dict[str, int] | Absent | None = ABSENT
    validation_error: float  # smooth L1 loss of its predictions

    @classmethod
    def of(cls, planner: NetworkPlanner, validation: Samples) -> Model:
        """``planner`` on the solved instances ``validation``."""
        method = Method(planner.name, planner)
        optimal, p = validation.trajectory, validation.parameters
        row, _ = comparison.run(planner.problem, method, p, optimal=optimal, batches=())
        metrics, error = row.metrics, present(row.validation_error)
        clear = metrics.success_clear
        assert metrics.success_at_plan_end is not None
        assert error is not None
        return cls(
            training=Training.of(planner),
            success=metrics.success.count,
            success_at_plan_end=metrics.success_at_plan_end.count,
            reached=metrics.reached.count,
            violation=None if metrics.violation is None else metrics.violation.mean.mean,
            knot_violation=None if metrics.knot_violation is None else metrics.knot_violation.mean.mean,
            success_clear=None if clear is None else {tolerance: found.count for tolerance, found in clear.items()},
            validation_error=error,
        )


@dataclass(frozen=True, kw_only=True)
class Range(Record):
    """The median over training seeds, and the range."""

    median: float  # of the values
    minimum: float = renamed("least")  # smallest value
    maximum: float = renamed("most")  # largest value

    @classmethod
    def of(cls, values: Sequence[float | None]) -> Range | Absent:
        """The range of ``values``, one a seed; :data:`ABSENT` for a metric that the problem does not have."""
        found = [value for value in values if value is not None]
        return cls(median=float(np.median(found)), minimum=min(found), maximum=max(found)) if found else ABSENT


@dataclass(frozen=True, kw_only=True)
class Paper(Record):
    """The paper's values of a model, as :class:`~moe_policy.experiments.benchmark.published.Published`."""

    validation_error: float | Absent = renamed("paper_validation_error", ABSENT)
    success: int | Absent = renamed("paper_success", ABSENT)
    violation: float | Absent = renamed("paper_violation", ABSENT)
    test_error: float | Absent = renamed("paper_test_error", ABSENT)
    cluster_sizes: tuple[int, ...] | Absent = renamed("paper_cluster_sizes", ABSENT)
    gate_accuracy: float | Absent = renamed("paper_gate_accuracy", ABSENT)
    expert_test_error: tuple[float, ...] | Absent = renamed("paper_expert_test_error", ABSENT)

    @classmethod
    def of(cls, published: Published | None) -> Paper:
        """What is known of ``published``."""
        values: dict[str, Any] = {} if published is None else asdict(published)
        return cls(**{name: value for name, value in values.items() if value is not None})


#: Fields of a model and of its training that are lists in a row.
_OF_MODEL = tuple(field.name for field in fields(Model) if field.name != "training")
_OF_TRAINING = tuple(field.name for field in fields(Training) if field.name not in ("seed", "samples"))


@dataclass(frozen=True, kw_only=True)
class TrainingRow(Record):
    """All seeds of one kind of model; lists hold a value for each seed."""

    name: str  # of the model
    samples: int  # number of training instances
    hidden: tuple[int, ...] | Absent = ABSENT  # widths of the hidden layers, in the ablation
    #: seed of the model in the package, where other fields are of this model alone
    shipped_seed: tuple[int, ...] | Absent = renamed("seed", ABSENT)
    seeds: tuple[int, ...]  # of the trainings
    success: tuple[int, ...]  # as in :class:`Model`, and so on
    success_at_plan_end: tuple[int, ...]
    reached: tuple[int, ...] | Absent = ABSENT
    violation: tuple[float | None, ...] | Absent = ABSENT
    knot_violation: tuple[float | None, ...] | Absent = ABSENT
    success_clear: tuple[dict[str, int] | None, ...] | Absent = ABSENT
    test_error: tuple[float, ...]
    validation_error: tuple[float, ...]
    training_seconds: tuple[float, ...]
    peak_memory_gb: tuple[float | None, ...] | Absent = ABSENT
    gate_accuracy: tuple[float | None, ...] | Absent = ABSENT
    part_test_errors: tuple[tuple[float, ...] | None, ...] | Absent = ABSENT
    cluster_sizes: tuple[tuple[int, ...] | None, ...] | Absent = ABSENT
    success_spread: Range  # median and range of ``success``, and so on
    success_at_plan_end_spread: Range
    violation_spread: Range | Absent = ABSENT
    knot_violation_spread: Range | Absent = ABSENT
    test_error_spread: Range
    validation_error_spread: Range
    training_seconds_spread: Range
    paper: Paper = inline()  # the paper's values

    @classmethod
    def of(cls, name: str, models: Sequence[Model], published: Published | None = None) -> TrainingRow:
        """The row of ``models``, one for each seed, all from equally many samples, with the ``published`` values."""
        trainings = [model.training for model in models]
        lists: dict[str, Any] = {name: tuple(present(getattr(model, name)) for model in models) for name in _OF_MODEL}
        lists |= {name: tuple(present(getattr(training, name)) for training in trainings) for name in _OF_TRAINING}
        spread = [name for name in lists if f"{name}_spread" in cls.__dataclass_fields__]
        spreads: dict[str, Any] = {f"{name}_spread": Range.of(lists[name]) for name in spread}
        seeds = tuple(training.seed for training in trainings)
        return cls(name=name, samples=trainings[0].samples, seeds=seeds, paper=Paper.of(published), **lists, **spreads)

    def clear(self, tolerance: str) -> Range | Absent:
        """The range of the successes within ``tolerance`` of the path constraints, where all seeds have it."""
        known = [counts[tolerance] for counts in present(self.success_clear) or () if counts is not None]
        return Range.of(known) if len(known) == len(self.seeds) else ABSENT

    def with_paper(self, published: Published | None) -> TrainingRow:
        """The row with the values of ``published``, or unchanged."""
        return self if published is None else replace(self, paper=Paper.of(published))

    def with_training(self, shipped: Training) -> TrainingRow:
        """The row with what it lacks, taken from the training of the ``shipped`` model."""
        lacking = [name for name in _OF_TRAINING if getattr(self, name) is ABSENT]
        taken: dict[str, Any] = {name: (getattr(shipped, name),) for name in lacking}
        return replace(self, shipped_seed=(shipped.seed,), **taken)


@dataclass(frozen=True, kw_only=True)
class TrainingComparison(Record):
    """All trained models of a problem: ``compare_training_<env>.json``."""

    settings: Settings | Absent = ABSENT  # of the training
    #: settings of the planners that were trained on all instances, by name
    whole: dict[str, Settings] | Absent = renamed("settings_on_all_problems", ABSENT)
    rows: tuple[TrainingRow, ...]  # the models of the benchmark
    ablation: tuple[TrainingRow, ...]  # single networks with other hidden layers
    sizes: tuple[TrainingRow, ...]  # models from fewer training instances
    clusters: dict[str, tuple[int, ...]] | Absent = ABSENT  # sizes of the clusters by partition, in older files
    discontinuity: DiscontinuityCase | Absent = renamed("jump", ABSENT)  # the case of its figure, in older files
    figures: Details | Absent = ABSENT  # what the figures show
    env_id: str  # id of the problem
    training_key: str | Absent = ABSENT  # of the training database
    seconds: float  # duration of the run
    provenance: Provenance  # of the record
