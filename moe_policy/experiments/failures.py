"""The failures of a mixture of experts, each with its cause (:mod:`moe_policy.experiments.diagnosis`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column
from moe_policy.rollouts.intervals import Proportion
from ocp_envs.support.provenance import Provenance


class Cause(StrEnum):
    """Causes of a failure, see :mod:`moe_policy.experiments.diagnosis`."""

    TRACKER = "tracker"
    GATE = "gate"
    DATA = "data"
    EXPERT = "expert"


class EvaluatedAt(StrEnum):
    """When a plan is evaluated: at the evaluation time of the rollout, or at the plan's end, before any regulation."""

    EVALUATION_TIME = "judging-time"
    PLAN_END = "plan-end"


@dataclass(frozen=True, kw_only=True)
class Failure(Record):
    """An instance whose tracked plan misses the goal."""

    index: int  # number of the instance in its database
    parameters: tuple[float, ...]  # p, np numbers
    cause: Cause  # why it fails
    mode: str  # name of the optimal solution family
    chosen: int  # number of the expert that the gate prefers
    confidence: float  # the gate's probability of it
    #: experts that count as right: that of the optimal family, or none if it has none; all of them where the clusters
    #: are not the problem's families
    right: tuple[int, ...]
    successful: tuple[int, ...]  # experts whose own plans succeed
    relative_gap: float | None  # relative cost difference of the two cheapest families; ``None`` if only one was found
    nearest_distance: float | None  # from p to the nearest training sample of the optimal family; ``None`` if none
    final_error: float  # ‖state error‖ when the plan is evaluated, or where the episode left the box
    predicted_error: float | None  # the same at the last knot of the plan; ``None`` where the plan is not finite
    left_box: bool  # whether the episode left the operating box
    clipped: bool  # whether the plan's duration was clipped to its bounds
    rejected: bool  # whether the plan was not finite


@dataclass(frozen=True, kw_only=True)
class Diagnosis(Record):
    """All failures of a mixture; ``unsolved``: validation instances without a solution, which are no cases."""

    env_id: str
    planner: str
    seed: int | None
    samples: int | None
    clusters: object
    judged_at: EvaluatedAt
    neighbours: int
    keys: dict[str, str]
    cases: int
    unsolved: int
    success: Proportion
    causes: dict[str, int]
    failures: tuple[Failure, ...]
    seconds: float
    provenance: Provenance


def counts(failures: Sequence[Failure]) -> dict[str, int]:
    """Number of failures by cause, causes without any included."""
    return {str(cause): sum(failure.cause is cause for failure in failures) for cause in Cause}


def _list(values: Sequence[float], form: str = "") -> str:
    return ", ".join(format(value, form) for value in values) or "none"


COLUMNS: tuple[Column[Failure], ...] = (
    Column("case", lambda row: row.index),
    Column("p", lambda row: _list(row.parameters, ".3g")),
    Column("cause", lambda row: str(row.cause)),
    Column("optimal family", lambda row: row.mode),
    Column("right", lambda row: _list(row.right)),
    Column("chosen", lambda row: row.chosen),
    Column("… with", lambda row: row.confidence, ".2f"),
    Column("would succeed", lambda row: _list(row.successful)),
    Column("cost difference of 2nd family", lambda row: row.relative_gap, ".2g"),
    Column("nearest sample", lambda row: row.nearest_distance, ".2g"),
    Column("error", lambda row: row.final_error, ".2g"),
    Column("predicted", lambda row: row.predicted_error, ".2g"),
)
