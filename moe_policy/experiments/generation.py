"""Records of how the databases and the hard sets of a problem were made."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.experiments.records import ABSENT, Absent, Record, inline, renamed
from ocp_envs.data.database import Database
from ocp_envs.support.provenance import Provenance, peak_memory_gb


@dataclass(frozen=True, kw_only=True)
class Totals(Record):
    """What solving took: sums over the instances in a database."""

    problems: int  # instances whose chunk is complete
    solved: int  # those with a solution
    solves: int  # attempts to solve them
    failures: int  # attempts without a verified solution
    fallbacks: int  # attempts that went to the second solver
    iterations: int  # of all attempts

    @classmethod
    def of(cls, database: Database) -> Totals:
        """The totals of ``database``."""
        return cls(**database.totals())


@dataclass(frozen=True, kw_only=True)
class Memory(Record):
    """Maximum memory in GB: of the process that generates, of its largest descendant, and a bound of all together."""

    parent_gb: float
    largest_child_gb: float
    bound_gb: float

    @classmethod
    def peak(cls, workers: int) -> Memory:
        """The maximum so far, with ``workers`` processes of which each has a child that solves."""
        own, largest = peak_memory_gb(), peak_memory_gb(descendants=True)
        return cls(parent_gb=own, largest_child_gb=largest, bound_gb=own + 2 * workers * largest)


@dataclass(frozen=True, kw_only=True)
class SplitGeneration(Record):
    """How the database of one split was generated.

    ``resumed_from``: instances that were solved before the last run, whose duration is ``seconds``; ``workers``:
    processes, or threads of a cluster, whose memory is not counted.
    """

    totals: Totals = inline()
    seconds: float
    problems_per_second: float
    resumed_from: int
    workers: int
    cluster: bool | Absent = ABSENT
    settings: object
    digest: str
    memory: Memory
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class Generation(Record):
    """How the databases of a problem were generated, by split."""

    splits: dict[str, SplitGeneration] = inline()


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
