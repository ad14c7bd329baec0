"""The records of how the databases of a problem were generated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from moe_policy.experiments.records import ABSENT, Absent, Record, inline, read
from moe_policy.experiments.totals import Totals
from ocp_envs.support.provenance import Provenance, peak_memory_gb


@dataclass(frozen=True, kw_only=True)
class Memory(Record):
    """Maximum memory in GB.

    Args:
        parent_gb: of the process that generates.
        largest_child_gb: of the largest of its descendants.
        bound_gb: an upper bound of all together.
    """

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

    Args:
        totals: sums over its instances.
        seconds: duration of the last run.
        problems_per_second: instances per second.
        resumed_from: number of instances that were solved before the last run.
        workers: number of processes, or of threads of a cluster.
        cluster: whether it was generated on a Dask cluster.
        settings: as the database stores them.
        digest: hash of the database's arrays.
        memory: maximum so far, without a cluster's workers.
        provenance: of the record.
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
    """How the databases of a problem were generated.

    Args:
        splits: by name.
    """

    splits: dict[str, SplitGeneration] = inline()

    @classmethod
    def at(cls, path: Path) -> Generation:
        """The record in the file ``path``; an empty one where there is none."""
        return read(path, cls) if path.exists() else cls(splits={})
