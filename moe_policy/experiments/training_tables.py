"""The trained models of a problem as records, and their table: medians over seeds next to the paper's values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from moe_policy.experiments.figures.details import Details, DiscontinuityCase
from moe_policy.experiments.records import ABSENT, Absent, Record, Scalar, renamed
from moe_policy.experiments.seeds import Range, TrainingRow
from moe_policy.experiments.tables import Column
from ocp_envs.support.provenance import Provenance

Settings = dict[str, Scalar]


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


@dataclass(frozen=True, kw_only=True)
class TrainingTable(Record):
    """The paper's table of ways to train, ours next to the paper's: ``table_training.json``."""

    quick: bool  # whether it is made from few instances
    rows: tuple[TrainingRow, ...]  # one for each model
    provenance: Provenance  # of the record


def _median(spread: Range) -> str:
    return f"{spread.median:.0f} ({spread.minimum}–{spread.maximum})"


def _error(value: float) -> str:
    """Three decimals; two digits of a value that would be 0.000."""
    return f"{value:.3f}" if value >= 1e-3 else f"{value:.2g}"


def _of_median(form: Callable[[float], str]) -> Callable[[Range], str]:
    return lambda spread: form(spread.median)


#: The table of models: medians over seeds, and their range.
TRAINING_COLUMNS: tuple[Column[TrainingRow], ...] = (
    Column("model", lambda row: row.name),
    Column("training problems", lambda row: row.samples, ","),
    Column("success, median (range)", lambda row: row.success_spread, _median),
    Column("paper", lambda row: row.paper.success, "d"),
    Column("at the plan's end", lambda row: row.success_at_plan_end_spread, _median),
    Column("mean violation at knots, m", lambda row: row.knot_violation_spread, _of_median("{:.3f}".format)),
    Column("paper", lambda row: row.paper.violation, ".3f"),
    Column("… on the whole path", lambda row: row.violation_spread, _of_median("{:.3f}".format)),
    Column("validation error", lambda row: row.validation_error_spread, _of_median(_error)),
    Column("paper", lambda row: row.paper.validation_error, _error),
    Column("test error", lambda row: row.test_error_spread, _of_median("{:.4f}".format)),
)
