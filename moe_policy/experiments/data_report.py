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
    """A solution family.

    Args:
        mode: its name.
        found: instances in which it was found.
        best: instances in which it is the cheapest.
        share: that as a fraction of the solved instances.
    """

    mode: str
    found: int
    best: int
    share: float


@dataclass(frozen=True, kw_only=True)
class CostDifferences(Record):
    """Relative cost differences of the two cheapest solution families.

    Args:
        problems: instances with two families or more.
        quantiles: by level; ``None`` without such instances.
        share_below: fraction of those instances below each of :data:`CLOSE`; ``None`` without any.
    """

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
    """Norms of state errors.

    Args:
        median: 50 % quantile.
        percent_95: 95 % quantile.
        largest: maximum.
    """

    median: float
    percent_95: float = renamed("95_percent")
    largest: float


@dataclass(frozen=True, kw_only=True)
class AccuracyReport(Record):
    """Accuracy of plans against the differential equation (:class:`ocp_envs.solvers.accuracy.Accuracy`).

    Args:
        cases: number of plans.
        not_integrable: plans whose controls lead to a state that cannot be integrated.
        end_in_the_goal_ball: plans whose controls alone end in the goal ball.
        interval: errors for each interval, in state units and scaled.
        open_loop: errors at the end of the plan, in state units and scaled.
    """

    cases: int
    not_integrable: int
    end_in_the_goal_ball: int
    interval: dict[str, ErrorQuantiles]
    open_loop: dict[str, ErrorQuantiles]


@dataclass(frozen=True, kw_only=True)
class SplitReport(Record):
    """What the database of one split holds.

    Args:
        size: number of instances it was made for.
        totals: sums over its instances.
        solves_per_problem: mean number of solves.
        iterations_per_solve: mean number of iterations.
        failures_by_kind: failed solves by how they ended; ``None`` where that is unknown.
        killed_at_most: maximum number of solves that timed out or crashed.
        unsolved: instances without a trajectory, by how their first solve ended.
        trajectories: number of stored trajectories.
        failing: those that fail the independent check.
        misfiled: those that belong to another family than they are stored for.
        modes_found: number of instances with 0, 1, … families.
        families: by solution family.
        differences: of the costs of the two cheapest families.
        bytes: size of the files.
        accuracy: of some plans; ``None`` without solved instances.
        settings: of the generation, as the database stores them.
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
    """How plans were integrated.

    Args:
        method: name of the integrator.
        rtol: its relative tolerance.
        atol: its absolute tolerance.
        seed: of the choice of plans.
    """

    method: str
    rtol: float
    atol: float
    seed: int


@dataclass(frozen=True, kw_only=True)
class DataReport(Record):
    """What the databases of a problem hold.

    Args:
        env_id: id of the problem.
        splits: by name.
        integration: how plans were integrated.
        provenance: of the record.
    """

    env_id: str = renamed("problem")
    splits: dict[str, SplitReport]
    integration: Integration
    provenance: Provenance
