"""The choice of k, the number of clusters of a mixture over k-means clusters, on the development set.

Mixtures with several k are compared by a *measure*: the number of rollouts in the goal ball at the plan's end or, where
the problem has path constraints, of rollouts that succeed and violate them by at most 5 cm on the whole path. The
chosen k is the smallest one whose median over the training seeds is not below the 95 % interval (Wilson's) of the
largest median: more clusters cost more weights and an expert learns from fewer instances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from moe_policy.experiments.cluster_models import ClusterModel
from moe_policy.experiments.seeds import Range
from moe_policy.reports.records import ABSENT, Absent, Record, Scalar, present
from moe_policy.reports.tables import Column, with_range
from moe_policy.rollouts.comparison import fewest
from ocp_envs.support.provenance import Provenance

#: Fields of a model whose range over the seeds a row has.
_RANGES = (
    "at_plan_end",
    "success",
    "clear_5_cm",
    "clear_1_cm",
    "relative_cost",
    "gate_accuracy",
    "test_error",
    "training_seconds",
)


@dataclass(frozen=True, kw_only=True)
class ClusterRow(Record):
    """All seeds of one k."""

    k: int  # number of clusters
    note: str = ""  # whether it is chosen, and whether the other experiments use it
    at_plan_end: Range  # median and range over the seeds of a field of the models, and so on
    success: Range
    clear_5_cm: Range | Absent = ABSENT
    clear_1_cm: Range | Absent = ABSENT
    relative_cost: Range | Absent = ABSENT
    gate_accuracy: Range | Absent = ABSENT
    test_error: Range
    training_seconds: Range
    models: tuple[ClusterModel, ...]  # one for each seed

    @classmethod
    def of(cls, models: Sequence[ClusterModel]) -> Self:
        """The row of ``models``, one for each seed of one k."""
        lists = {name: [present(getattr(model, name)) for model in models] for name in _RANGES}
        ranges: dict[str, Any] = {name: Range.of(values) for name, values in lists.items()}
        return cls(k=models[0].k, models=tuple(models), **ranges)

    @property
    def measure(self) -> float:
        """What k is chosen by, the median of a number of rollouts."""
        return (self.at_plan_end if self.clear_5_cm is ABSENT else self.clear_5_cm).median


@dataclass(frozen=True, kw_only=True)
class ClusterChoice(Record):
    """Mixtures over k-means clusters with several k: ``clusters_<env>.json``."""

    env_id: str  # id of the problem
    split: str  # set of the initial conditions
    cases: int  # number of initial conditions
    samples: int  # number of training instances
    chosen: int  # the smallest k whose measure is not below the interval of the largest
    used: int  # k of the other experiments
    interval: tuple[float, float]  # of the largest measure, a number of rollouts
    rows: tuple[ClusterRow, ...]  # by increasing k
    settings: dict[str, Scalar]  # of the trainings
    training_key: str  # of the training database
    seconds: float  # duration of the run
    provenance: Provenance  # of the record


def chosen(rows: Sequence[ClusterRow], cases: int) -> tuple[int, tuple[float, float]]:
    """The k chosen among ``rows``, evaluated on ``cases`` instances, and the interval of the largest measure."""
    return fewest({row.k: row.measure for row in rows}, cases)


def noted(rows: Sequence[ClusterRow], chosen: int, used: int) -> tuple[ClusterRow, ...]:
    """``rows`` by increasing k, with notes on the ``chosen`` k and the one that is ``used``."""

    def note(k: int) -> str:
        return ", ".join(text for text, of in (("chosen", chosen), ("used", used)) if of == k)

    return tuple(replace(row, note=note(row.k)) for row in sorted(rows, key=lambda row: row.k))


CLUSTER_COLUMNS: tuple[Column[ClusterRow], ...] = (
    Column("k", lambda row: row.k),
    Column("", lambda row: row.note),
    Column("clear within 5 cm (seeds)", lambda row: row.clear_5_cm, with_range(".0f")),
    Column("… 1 cm", lambda row: row.clear_1_cm, with_range(".0f")),
    Column("at the plan's end (seeds)", lambda row: row.at_plan_end, with_range(".0f")),
    Column("success", lambda row: row.success, with_range(".0f")),
    Column("cost / optimal", lambda row: row.relative_cost, with_range(".4f")),
    Column("gate accuracy", lambda row: row.gate_accuracy, with_range(".3f")),
    Column("weights", lambda row: row.models[0].parameters_total, ","),
    Column("… active", lambda row: row.models[0].parameters_active, ","),
)
