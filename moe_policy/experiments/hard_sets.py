"""Records of how the hard sets of a problem were made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from moe_policy.experiments.records import ABSENT, Absent, Record, inline, read, renamed
from moe_policy.experiments.totals import Totals
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class SearchReport(Record):
    """How the exhaustive search compares with the choice of the candidates.

    Args:
        tolerance: relative difference from which two costs count as different.
        compared: candidates for which both have costs.
        found_better: those for which the search found a lower cost.
        missed: those for which it found a higher one.
    """

    tolerance: float
    compared: int
    found_better: int
    missed: int


@dataclass(frozen=True, kw_only=True)
class HardSetReport(Record):
    """How one hard set was made (:func:`ocp_envs.sets.making.make`).

    Args:
        seed: of the draw and of the guesses.
        size: number of instances.
        drawn: number of uniform draws.
        slack: maximum relative cost difference of a candidate.
        within_slack: number of draws within it.
        limit: maximum distance from the discontinuity.
        fraction_within_limit: of the draws.
        beyond: minimum and maximum excess beyond the box, in half widths.
        candidates: number of instances that were solved.
        confirmed: those that meet the condition.
        unsolved: those without a solution.
        guesses_per_winding: of the exhaustive search.
        search: compared with the choice of the candidates; ``None`` where that solves nothing.
        solves: of the candidates.
        settings: of the generation.
        seconds: duration of the run.
        resumed: whether an earlier run had begun.
        workers: processes; ``None`` for one per core.
        provenance: of the record.
    """

    seed: int
    size: int
    drawn: int | Absent = ABSENT
    slack: float | Absent = ABSENT
    within_slack: int | Absent = ABSENT
    limit: float | Absent = ABSENT
    fraction_within_limit: float | Absent = renamed("share_within_limit", ABSENT)
    beyond: tuple[float, float] | Absent = ABSENT
    candidates: int
    confirmed: int
    unsolved: int
    guesses_per_winding: int
    search: SearchReport | None
    solves: Totals
    settings: object
    seconds: float
    resumed: bool
    workers: int | None
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class HardSets(Record):
    """How the hard sets of a problem were made: ``splits_<env>.json``.

    Args:
        sets: by name.
    """

    sets: dict[str, HardSetReport] = inline()

    @classmethod
    def at(cls, path: Path) -> HardSets:
        """The record in the file ``path``; an empty one where there is none."""
        return read(path, cls) if path.exists() else cls(sets={})
