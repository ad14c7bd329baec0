"""Records of how the hard sets of a problem were made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from moe_policy.experiments.records import ABSENT, Absent, Record, inline, read, renamed
from moe_policy.experiments.totals import Totals
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class SearchReport(Record):
    """How the exhaustive search compares with the choice of the candidates."""

    tolerance: float  # relative difference from which two costs count as different
    compared: int  # candidates for which both have costs
    found_better: int  # those for which the search found a lower cost
    missed: int  # those for which it found a higher one


@dataclass(frozen=True, kw_only=True)
class HardSetReport(Record):
    """How one hard set was made (:func:`ocp_envs.sets.making.make`)."""

    seed: int  # of the draw and of the guesses
    size: int  # number of instances
    drawn: int | Absent = ABSENT  # number of uniform draws
    slack: float | Absent = ABSENT  # maximum relative cost difference of a candidate
    within_slack: int | Absent = ABSENT  # number of draws within it
    limit: float | Absent = ABSENT  # maximum distance from the discontinuity
    fraction_within_limit: float | Absent = renamed("share_within_limit", ABSENT)  # of the draws
    beyond: tuple[float, float] | Absent = ABSENT  # minimum and maximum excess beyond the box, in half widths
    candidates: int  # number of instances that were solved
    confirmed: int  # those that meet the condition
    unsolved: int  # those without a solution
    guesses_per_winding: int  # of the exhaustive search
    search: SearchReport | None  # compared with the choice of the candidates; ``None`` where that solves nothing
    solves: Totals  # of the candidates
    settings: object  # of the generation
    seconds: float  # duration of the run
    resumed: bool  # whether an earlier run had begun
    workers: int | None  # processes; ``None`` for one per core
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class HardSets(Record):
    """How the hard sets of a problem were made: ``splits_<env>.json``."""

    sets: dict[str, HardSetReport] = inline()  # by name

    @classmethod
    def at(cls, path: Path) -> HardSets:
        """The record in the file ``path``; an empty one where there is none."""
        return read(path, cls) if path.exists() else cls(sets={})
