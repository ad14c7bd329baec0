"""How solution families that are found by continuation compare with those that a problem declares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from sklearn.metrics import adjusted_rand_score

from moe_policy.learning.families import NEIGHBOURS, SMALLEST, WIDTH
from moe_policy.learning.graph_cuts import Cut, Parts
from moe_policy.reports.records import ABSENT, Absent, Record, read
from moe_policy.reports.tables import DASH, Column
from ocp_envs.data.beyond import Beyond
from ocp_envs.data.continuation import Continuation
from ocp_envs.data.samples import Samples
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.support.provenance import Provenance

#: A trajectory that costs less than the stored one by this fraction shows that the latter is not the optimum.
CHEAPER = 1e-3


@dataclass(frozen=True, kw_only=True)
class Found(Record):
    """One family that was found."""

    family: int  # number of the family, the largest first
    instances: int  # number of its instances
    declared: dict[str, int]  # number of them in each declared family that occurs among them

    @property
    def mainly(self) -> str:
        """The declared family of most of its instances."""
        return max(self.declared, key=lambda name: self.declared[name])

    @property
    def others(self) -> int:
        """Number of its instances in other declared families."""
        return self.instances - self.declared[self.mainly]


@dataclass(frozen=True, kw_only=True)
class Gaps(Record):
    """Where several families are known: they were continued beyond their borders."""

    margin: float  # largest excess of their cost over the best one, relative to it
    further: int  # number of trajectories beyond the border of their family
    instances: int  # number of instances at which at least two families are known
    declared: int | None  # the same of the declared families within the margin; null where the problem declares one
    solves: int  # number of solves
    seconds: float  # duration of these

    @classmethod
    def of(cls, samples: Samples, found: Beyond, margin: float, seconds: float) -> Self:
        """The gaps of ``found``, which continued the families of ``samples`` in ``seconds``."""
        several = len(samples.problem.modes) > 1
        declared = int((relative_cost_difference(samples.mode_costs) <= margin).sum()) if several else None
        two = int((np.isfinite(found.cost).sum(axis=1) > 1).sum())
        return cls(
            margin=margin,
            further=len(found.rows),
            instances=two,
            declared=declared,
            solves=found.solves,
            seconds=seconds,
        )


@dataclass(frozen=True, kw_only=True)
class Families(Record):
    """Families that continuation finds in a training set: ``families_<env>.json``."""

    env_id: str  # id of the problem
    samples: int  # number of instances
    neighbours: int  # number of neighbours with which each instance is compared
    width: float  # width of a cut below which a part is split
    smallest: float  # the smallest part, as a fraction of all instances
    rows: tuple[Found, ...]  # the families, the largest first
    adjusted_rand_index: float  # agreement with the declared families; 1 for equal partitions
    refined_index: float  # the same where families that are mainly of one declared family count as one
    components: tuple[int, ...]  # numbers of instances of the largest connected components
    pieces: int  # number of all connected components
    merged: int  # number of instances in pieces that are smaller than the smallest part
    accepted: tuple[Cut, ...]  # cuts along which components were split
    rejected: tuple[Cut, ...]  # best cut of each family, along which it was not split
    pairs: int  # number of pairs of neighbours
    not_joined: int  # number of them that do not lead to each other in both directions
    one_way: int  # number of them that lead to each other in one direction alone
    joined_across: int  # number of joined pairs of different declared families
    apart_within: int  # number of pairs of one declared family that are not joined
    distance_joined: float  # largest distance of a solve that agrees
    distance_apart: float | None  # smallest distance of a solve that does not; null without any
    solves: int  # number of solves, two for each pair
    unsolved: int  # number of them that found nothing
    iterations: int  # of the solver in all of them
    not_optimal: int  # number of instances for which a neighbour's optimum leads to a cheaper trajectory
    seconds: float | None  # duration of the solves; null where some of them were kept from an earlier run
    workers: int  # number of processes that solved
    training_key: str  # of the training database
    gaps: Gaps | Absent = ABSENT  # where several families were found
    provenance: Provenance  # of the record

    @property
    def k(self) -> int:
        """Number of families."""
        return len(self.rows)


@dataclass(frozen=True, kw_only=True)
class FamiliesTable(Record):
    """The families of all problems: ``table_families.json``."""

    rows: tuple[Families, ...]  # one for each problem, by its id
    provenance: Provenance  # of the table

    @classmethod
    def of(cls, folder: Path, provenance: Provenance) -> Self:
        """The table of all records of families in ``folder``."""
        return cls(
            rows=tuple(read(path, Families) for path in sorted(folder.glob("families_*.json"))), provenance=provenance
        )


def found(samples: Samples, parts: Parts) -> tuple[Found, ...]:
    """What each of ``parts`` consists of, by the declared families of ``samples``."""
    names = samples.problem.modes.names
    rows = []
    for family in range(int(parts.values.max()) + 1):
        modes = samples.mode[parts.values == family]
        declared = {names[mode]: int(count) for mode, count in zip(*np.unique(modes, return_counts=True))}
        rows.append(Found(family=family, instances=len(modes), declared=declared))
    return tuple(rows)


def families(
    samples: Samples,
    continuation: Continuation,
    parts: Parts,
    *,
    training_key: str,
    seconds: float | None,
    workers: int,
    provenance: Provenance,
    gaps: Gaps | Absent = ABSENT,
) -> Families:
    """The record of the ``parts`` of ``samples`` that were found from their ``continuation``."""
    agrees, joined, distance = continuation.agrees, continuation.joined, continuation.distance
    same = samples.mode[continuation.pairs[:, 0]] == samples.mode[continuation.pairs[:, 1]]
    solved, at = np.isfinite(distance), continuation.pairs[:, ::-1]
    apart, rows = distance[solved & ~agrees], found(samples, parts)
    mainly = np.array([samples.problem.modes.names.index(row.mainly) for row in rows])
    return Families(
        env_id=samples.problem.id,
        samples=len(samples),
        neighbours=NEIGHBOURS,
        width=WIDTH,
        smallest=SMALLEST,
        rows=rows,
        adjusted_rand_index=float(adjusted_rand_score(samples.mode, parts.values)),
        refined_index=float(adjusted_rand_score(samples.mode, mainly[parts.values])),
        components=parts.components[:10],
        pieces=len(parts.components),
        merged=int(parts.moved.sum()),
        accepted=parts.accepted,
        rejected=parts.rejected,
        pairs=len(joined),
        not_joined=int((~joined).sum()),
        one_way=int((agrees.any(axis=1) & ~joined).sum()),
        joined_across=int((joined & ~same).sum()),
        apart_within=int((~joined & same).sum()),
        distance_joined=float(distance[agrees].max(initial=0.0)),
        distance_apart=float(apart.min()) if len(apart) else None,
        solves=distance.size,
        unsolved=int((~solved).sum()),
        iterations=int(continuation.iterations.sum()),
        not_optimal=len(np.unique(at[continuation.excess < -CHEAPER])),
        seconds=seconds,
        workers=workers,
        training_key=training_key,
        gaps=gaps,
        provenance=provenance,
    )


def thinnest(cuts: Sequence[Cut]) -> float | None:
    """The width of the thinnest of ``cuts``; ``None`` without any."""
    return min((cut.width for cut in cuts), default=None)


FAMILY_COLUMNS: tuple[Column[Families], ...] = (
    Column("problem", lambda row: row.env_id),
    Column("instances", lambda row: row.samples, ","),
    Column("families", lambda row: row.k),
    Column("their sizes", lambda row: ", ".join(f"{found.instances:,}" for found in row.rows)),
    Column("adjusted Rand index", lambda row: row.adjusted_rand_index if row.k > 1 else None, ".4f"),
    Column("… up to refinement", lambda row: row.refined_index if row.k > 1 else None, ".4f"),
    Column("not as declared", lambda row: sum(found.others for found in row.rows), ","),
    Column("width of cuts", lambda row: ", ".join(f"{cut.width:.2g}" for cut in row.accepted) or DASH),
    Column("… of the best other cut", lambda row: thinnest(row.rejected), ".2f"),
    Column("pairs", lambda row: row.pairs, ","),
    Column("… not joined", lambda row: row.not_joined, ","),
    Column("… joined, not as declared", lambda row: row.joined_across, ","),
    Column("instances not optimal", lambda row: row.not_optimal, ","),
    Column("iterations a solve", lambda row: row.iterations / row.solves, ".1f"),
)
