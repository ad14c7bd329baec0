"""The records of what databases hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.experiments.records import Record, inline, renamed
from moe_policy.experiments.totals import Totals
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance

#: Relative cost differences below which two solution families count as close.
CLOSE = (0.001, 0.01, 0.03)
#: Levels of the quantiles that are reported.
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, kw_only=True)
class FamilyRow(Record):
    """Instances in which a solution family was found, and in which it is cheapest, also as a fraction of the solved."""

    mode: str
    found: int
    best: int
    share: float


@dataclass(frozen=True, kw_only=True)
class CostDifferences(Record):
    """Relative cost differences of the two cheapest families: quantiles by level, and fractions below :data:`CLOSE`."""

    problems: int
    quantiles: dict[str, float] | None
    share_below: dict[str, float] | None

    @classmethod
    def of(cls, differences: Array) -> CostDifferences:
        """The statistics of ``differences`` (B,)."""
        if not len(differences):
            return cls(problems=0, quantiles=None, share_below=None)
        return cls(
            problems=len(differences),
            quantiles={f"{level:g}": float(np.quantile(differences, level)) for level in LEVELS},
            share_below={f"{limit:g}": float((differences < limit).mean()) for limit in CLOSE},
        )


@dataclass(frozen=True, kw_only=True)
class ErrorQuantiles(Record):
    """Norms of state errors."""

    median: float
    percent_95: float = renamed("95_percent")
    largest: float


@dataclass(frozen=True, kw_only=True)
class AccuracyReport(Record):
    """Accuracy of plans (:class:`ocp_envs.solvers.accuracy.Accuracy`); errors in state units and scaled."""

    cases: int
    not_integrable: int
    end_in_the_goal_ball: int
    interval: dict[str, ErrorQuantiles]
    open_loop: dict[str, ErrorQuantiles]


@dataclass(frozen=True, kw_only=True)
class SplitReport(Record):
    """What the database of one split holds.

    ``size``: number of instances it was made for; ``killed_at_most``: solves that may have timed out or crashed, each a
    failure that went to the fallback; ``unsolved``: by how the first solve ended; ``misfiled``: trajectories of another
    family than that of their slot; ``modes_found``: number of instances with 0, 1, … families.
    """

    size: int
    totals: Totals = inline()
    solves_per_problem: float
    iterations_per_solve: float
    failures_by_kind: dict[str, int] | None
    killed_at_most: int = renamed("timed_out_or_crashed_at_most")
    unsolved: dict[str, int] = renamed("unsolved_by_first_solve")
    trajectories: int
    failing: int = renamed("failing_the_check")
    misfiled: int = renamed("in_the_slot_of_another_mode")
    modes_found: tuple[int, ...]
    families: tuple[FamilyRow, ...] = renamed("classes")
    differences: CostDifferences = renamed("gap")
    bytes: int
    accuracy: AccuracyReport | None
    settings: object


@dataclass(frozen=True, kw_only=True)
class Integration(Record):
    """How plans were integrated; ``seed``: of their choice."""

    method: str
    rtol: float
    atol: float
    seed: int


@dataclass(frozen=True, kw_only=True)
class DataReport(Record):
    """What the databases of a problem hold, by split."""

    env_id: str
    splits: dict[str, SplitReport]
    integration: Integration
    provenance: Provenance
