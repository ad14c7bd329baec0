"""The records of how the databases of a problem were generated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from moe_policy.experiments.records import ABSENT, Absent, Record, inline, read
from moe_policy.experiments.totals import Totals
from ocp_envs.support.provenance import Provenance, peak_memory_gb


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

    @classmethod
    def at(cls, path: Path) -> Generation:
        """The record in the file ``path``; an empty one where there is none."""
        return read(path, cls) if path.exists() else cls(splits={})
