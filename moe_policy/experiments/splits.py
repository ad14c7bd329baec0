"""The comparison of methods on the splits of a problem.

The splits are ``uniform`` (the validation set), ``boundary`` (near the discontinuity of the optimum), ``near`` (near
the goal) and ``outside`` (outside the parameter box), see :mod:`ocp_envs.sets.splits`. Instances of ``uniform`` and
``boundary`` together make the curves over the distance from the discontinuity
(:mod:`moe_policy.experiments.distances`): both sets are uniform where they overlap, so a bin of both is a bin of
uniform instances at that distance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from moe_policy.experiments.comparison import ComparisonRow
from moe_policy.experiments.distances import DistanceCurves, measures_of
from moe_policy.experiments.trainings import Run
from moe_policy.reports.metric_columns import spreads_of
from moe_policy.reports.records import ABSENT, Absent, Record, inline, present, renamed
from moe_policy.reports.split_table import Line, by_split
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Estimate, Spread, disjoint
from moe_policy.rollouts.metrics import Metrics
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance

#: Those whose instances make the curves.
BINNED = ("uniform", "boundary")


@dataclass(frozen=True, kw_only=True)
class SplitRow(Record):
    """One method on one split."""

    row: ComparisonRow = inline()  # as in a comparison
    judged: dict[str, Estimate | None]  # an estimate by measure; ``None`` where the method has no plans to measure

    @classmethod
    def of(cls, problem: OptimalControlProblem, row: ComparisonRow, episodes: Episodes) -> Self:
        """The row of ``problem`` with the estimates from its ``episodes``."""
        return cls(row=row, judged={m.name: m.estimate(problem, episodes) for m in measures_of(problem)})


@dataclass(frozen=True, kw_only=True)
class SplitMethod(Record):
    """One method on all splits."""

    name: str  # of the method
    splits: dict[str, SplitRow] = inline()  # its rows by split


@dataclass(frozen=True, kw_only=True)
class SeedsRow(Record):
    """All training seeds of a network, trained with equal settings on equal instances."""

    name: str  # of the network
    samples: int  # number of training instances
    epochs: int  # passes over them
    seeds: tuple[int, ...]  # of the trainings
    cases: dict[str, int]  # number of instances by split
    splits: dict[str, dict[str, Spread]]  # by split and measure

    @classmethod
    def of(cls, runs: Sequence[Run], metrics: Mapping[str, Sequence[Metrics]]) -> Self:
        """The row of the trainings ``runs``, whose ``metrics`` by split are those of the runs in turn."""
        (kind,) = {(run.name, run.samples, run.settings.epochs) for run in runs}
        name, samples, epochs = kind
        splits = {split: spreads_of(found) for split, found in metrics.items()}
        return cls(
            name=name,
            samples=samples,
            epochs=epochs,
            seeds=tuple(run.seed for run in runs),
            cases={split: found[0].success.total for split, found in metrics.items()},
            splits=splits,
        )

    def label(self, split: str) -> str:
        """Name in the table of ``split``."""
        return f"{self.name}, {len(self.seeds)} seeds, of {self.cases[split]:,}"


@dataclass(frozen=True, kw_only=True)
class CostDifferenceRange(Record):
    """The relative difference J / J_ref − 1 of the optimal planner's costs from the reference."""

    within: int = renamed("within_0.1_percent")  # number of cases within 0.1 %
    largest: float  # maximum, at least 0
    smallest: float  # minimum, at most 0

    @classmethod
    def of(cls, costs: Array, reference: Array) -> Self:
        """The differences of ``costs`` (B,), all finite, from ``reference`` (B,)."""
        difference = costs / reference - 1
        return cls(
            within=int((np.abs(difference) < 1e-3).sum()),
            largest=float(difference.max(initial=0.0)),
            smallest=float(difference.min(initial=0.0)),
        )


@dataclass(frozen=True, kw_only=True)
class Separation(Record):
    """Whether the single network and a mixture differ by more than their intervals."""

    metric: str  # name of the measure
    mixture: str  # name of the mixture
    disjoint: bool  # whether the intervals have no point in common


@dataclass(frozen=True, kw_only=True)
class SplitSummary(Record):
    """What was compared on one split."""

    cases: int  # number of instances
    optimal_solved: int  # number of those that the optimal planner solved
    reference_difference: CostDifferenceRange = renamed("reference_gap")  # of its costs from the reference
    separations: tuple[Separation, ...]  # between the single network and the mixtures


@dataclass(frozen=True, kw_only=True)
class SplitComparison(Record):
    """All methods of one problem on its splits: ``compare_splits_<env>.json``."""

    env_id: str  # id of the problem
    splits: dict[str, SplitSummary]  # what was compared, by split
    rows: tuple[SplitMethod, ...]  # one for each method
    seeds: tuple[SeedsRow, ...] | Absent = ABSENT  # networks over training seeds, where they were trained
    curves: DistanceCurves | None  # over the distance from the discontinuity; ``None`` where there is none
    seconds: float  # duration of the run
    provenance: Provenance  # of the record
    added: dict[str, Provenance] | Absent = ABSENT  # of the rows that were added later, by method

    def with_rows(self, other: SplitComparison, names: Collection[str]) -> SplitComparison:
        """This record with the rows of ``names`` in ``other``, in place of its own of these names if any.

        Raises:
            ValueError: ``other`` is of other instances.
        """
        ours, theirs = ({split: found.cases for split, found in record.splits.items()} for record in (self, other))
        if ours != theirs:
            raise ValueError(f"rows cannot be added: the record has the cases {ours}, and the new rows {theirs}")
        old = [row for row in self.rows if row.name not in names]
        new = [row for row in other.rows if row.name in names]
        seeds = present(other.seeds) or ()
        before = [row for row in present(self.seeds) or () if row.name not in {row.name for row in seeds}]
        mixed = {row.name: row for row in (*old, *new)}
        problem = problem_of(self.env_id)
        splits = {
            split: replace(found, separations=separations(problem, {n: row.splits[split] for n, row in mixed.items()}))
            for split, found in self.splits.items()
        }
        return replace(
            self,
            splits=splits,
            rows=tuple(mixed.values()),
            seeds=(*before, *seeds) or ABSENT,
            curves=None
            if self.curves is None or other.curves is None
            else self.curves.with_methods(other.curves, names),
            added=(present(self.added) or {}) | dict.fromkeys(names, other.provenance),
        )


def lines(record: SplitComparison) -> list[Line]:
    """The lines of the table of ``record``, split by split."""
    found = []
    for split in record.splits:
        found += [Line(split, method.name, method.splits[split].row.metrics) for method in record.rows]
        found += [Line(split, row.label(split), spreads=row.splits[split]) for row in present(record.seeds) or ()]
    return by_split(found)


def uniform_row(record: SplitComparison, name: str, cases: int) -> ComparisonRow | None:
    """The row of the method ``name`` on the split ``uniform``, if there is one and it is of so many ``cases``."""
    if "uniform" not in record.splits or record.splits["uniform"].cases != cases:
        return None
    return next((method.splits["uniform"].row for method in record.rows if method.name == name), None)


def separations(problem: OptimalControlProblem, rows: Mapping[str, SplitRow]) -> tuple[Separation, ...]:
    """Whether the single network and each mixture in ``rows`` of one split differ by more than their intervals."""
    found = []
    for measure in measures_of(problem):
        single = rows["snn"].judged[measure.name] if "snn" in rows else None
        for name, row in rows.items():
            mixture = row.judged[measure.name]
            if name.startswith("moe-") and single is not None and mixture is not None:
                apart = disjoint(single, mixture)
                found.append(Separation(metric=measure.name, mixture=name, disjoint=apart))
    return tuple(found)
