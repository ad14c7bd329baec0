"""The records of what databases hold, and their text with one column for each split."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from moe_policy.experiments.generation import Totals
from moe_policy.reports.records import Record, inline, renamed
from moe_policy.reports.tables import DASH, Column, text_table
from ocp_envs.solvers.accuracy import ATOL, RTOL
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance

#: The ways in which a solve fails.
FAILURES = (Status.NOT_CONVERGED, Status.TIMED_OUT, Status.CRASHED, Status.CHECK_FAILED)
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


def text(title: str, records: Mapping[str, SplitReport]) -> str:
    """The report with ``title`` as its first line, from ``records`` by name of the split."""
    columns = {
        name: _effort(record) | _contents(record) | _accuracy(record.accuracy) for name, record in records.items()
    }
    headings = dict.fromkeys(heading for lines in columns.values() for heading in lines)
    rows = [{"": heading, **{name: lines.get(heading) for name, lines in columns.items()}} for heading in headings]
    notes = [
        "cost difference: (second − best) / best over the instances with two solution families or more; families that",
        "cost neighbours more than the margin of the generation are not sought, so few large differences are known",
        f"error: norm against DOP853 (rtol {RTOL:g}, atol {ATOL:g}), median / 95 % / maximum",
        "solves by the fallback: they include every solve that hung or crashed in the first solver",
    ]
    if any(record.failures_by_kind is None for record in records.values()):
        notes.append("not stored: databases keep how many solves of an instance failed, not how each of them ended")
    shown = [Column(name, itemgetter(name)) for name in ("", *columns)]
    return "\n".join([title, "", text_table(rows, shown), *notes]) + "\n"


def _words(name: str) -> str:
    return name.lower().replace("_", " ")


def _percent(fraction: float | None) -> str:
    return DASH if fraction is None else f"{100 * fraction:.3g} %"


def _effort(record: SplitReport) -> dict[str, str]:
    """What solving took and how it ended, by heading."""
    totals, known = record.totals, record.failures_by_kind
    unsolved = ", ".join(f"{count:,} {_words(name)}" for name, count in record.unsolved.items() if count)
    kinds = "not stored" if known is None else " / ".join(f"{known[kind.name]:,}" for kind in FAILURES)
    return {
        "instances": f"{totals.problems:,} of {record.size:,}",
        "solved": f"{totals.solved:,}",
        "unsolved, by their first solve": unsolved or "none",
        "solves (per instance)": f"{totals.solves:,} ({record.solves_per_problem:.2f})",
        "failed solves": f"{totals.failures:,}",
        f"… {' / '.join(_words(kind.name) for kind in FAILURES)}": kinds,
        "… timed out or crashed, at most": f"{record.killed_at_most:,}",
        "solves by the fallback": f"{totals.fallbacks:,}",
        "iterations (per solve)": f"{totals.iterations:,} ({record.iterations_per_solve:.2f})",
    }


def _contents(record: SplitReport) -> dict[str, str]:
    """What is stored, by heading."""
    quantiles, below = record.differences.quantiles, record.differences.share_below or {}
    levels = " / ".join(f"{100 * level:g}" for level in LEVELS)
    lines = {
        "size of the files": f"{record.bytes / 1e6:.1f} MB",
        "trajectories, all checked again": f"{record.trajectories:,}",
        "… failing the check": f"{record.failing:,}",
        "… stored for another family": f"{record.misfiled:,}",
        "instances with 0 / 1 / … families": " / ".join(f"{count:,}" for count in record.modes_found),
    }
    for row in record.families:
        lines[f"cheapest: {row.mode}"] = f"{row.best:,} ({_percent(row.share)}); found {row.found:,}"
    lines[f"cost difference, {levels} % quantile"] = (
        DASH if quantiles is None else " / ".join(f"{value:.3g}" for value in quantiles.values())
    )
    return lines | {f"cost difference below {100 * limit:g} %": _percent(below.get(f"{limit:g}")) for limit in CLOSE}


def _accuracy(record: AccuracyReport | None) -> dict[str, str]:
    """How accurate the plans are, by heading."""
    if record is None:
        return {}
    lines = {
        f"error {name}, {_words(unit)}": _errors(errors[unit])
        for name, errors in (("per interval", record.interval), ("open loop", record.open_loop))
        for unit in ("state_units", "scaled")
    }
    return lines | {
        "open loop ends in the goal ball": f"{record.end_in_the_goal_ball:,} of {record.cases:,}",
        "not integrable": f"{record.not_integrable:,}",
    }


def _errors(errors: ErrorQuantiles) -> str:
    return f"{errors.median:.1e} / {errors.percent_95:.1e} / {errors.largest:.1e}"
