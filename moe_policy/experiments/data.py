"""What a database holds: statistics, with every stored trajectory checked again.

A database stores *how many* solves of an instance failed, not how each of them ended, so this is not reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from moe_policy.experiments.data_report import AccuracyReport, CostDifferences, FamilyRow, SplitReport
from moe_policy.experiments.totals import Totals
from ocp_envs.data.database import Database
from ocp_envs.data.layout import StoredRows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.solvers.accuracy import Accuracy, accuracy
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Ints

#: The ways in which a solve fails.
FAILURES = (Status.NOT_CONVERGED, Status.TIMED_OUT, Status.CRASHED, Status.CHECK_FAILED)


@dataclass(frozen=True, eq=False)
class Contents:
    """What a database holds.

    Args:
        problem: the problem.
        size: number of instances it was made for.
        totals: sums over its instances.
        unsolved: instances without a trajectory, by how their first solve ended.
        killed_at_most: solves that ended in a time-out or a crash: each is a failure, and went to the fallback.
        failing: stored trajectories that fail the independent check.
        misfiled: stored trajectories of another family than that of their slot.
        modes_found: number of instances in which 0, 1, … families were found, (modes + 1,).
        found, best: number of instances in which a family was found, and in which it is the cheapest, (modes,).
        differences: (second − best) / |best| of the instances with at least two families.
        bytes: size of the files.
    """

    problem: OptimalControlProblem
    size: int
    totals: Totals
    unsolved: Mapping[str, int]
    killed_at_most: int
    failing: int
    misfiled: int
    modes_found: Ints
    found: Ints
    best: Ints
    differences: Array
    bytes: int

    @property
    def trajectories(self) -> int:
        """Number of stored trajectories."""
        return int(self.found.sum())

    @property
    def failures_by_kind(self) -> dict[str, int] | None:
        """Failed solves by how they ended; ``None`` where that is unknown, which is wherever there are any."""
        return None if self.totals.failures else {kind.name: 0 for kind in FAILURES}

    def report(self, accuracy: Accuracy | None, settings: object) -> SplitReport:
        """The record of a split.

        Args:
            accuracy: of some of its plans.
            settings: of the generation, as the database stores them.
        """
        totals, solved = self.totals, max(self.totals.solved, 1)
        return SplitReport(
            size=self.size,
            totals=totals,
            solves_per_problem=totals.solves / max(totals.problems, 1),
            iterations_per_solve=totals.iterations / max(totals.solves, 1),
            failures_by_kind=self.failures_by_kind,
            killed_at_most=self.killed_at_most,
            unsolved=dict(self.unsolved),
            trajectories=self.trajectories,
            failing=self.failing,
            misfiled=self.misfiled,
            modes_found=tuple(self.modes_found.tolist()),
            families=tuple(
                FamilyRow(mode=name, found=found, best=best, share=best / solved)
                for name, found, best in zip(self.problem.modes.names, self.found.tolist(), self.best.tolist())
            ),
            differences=CostDifferences.of(self.differences),
            bytes=self.bytes,
            accuracy=None if accuracy is None else AccuracyReport.from_json(accuracy.record()),
            settings=settings,
        )


@dataclass(frozen=True, eq=False)
class _Block:
    """The same of some rows; ``statuses`` (Status,) counts instances by how their first solve ended."""

    failing: int
    misfiled: int
    killed: int
    modes_found: Ints
    found: Ints
    best: Ints
    statuses: Ints
    differences: Array


def _block(database: Database, where: slice, rows: StoredRows) -> _Block:
    problem, modes = database.problem, len(database.problem.modes)
    present, full = rows.present, rows.found
    row, mode = np.nonzero(full)
    trajectory, parameters = problem.unflatten(rows.z[row, mode]), database.stored_parameters(where)[row]
    filed = problem.modes.classify(problem, parameters, trajectory, rows.multipliers[row, mode])
    count, cost = full.sum(axis=1), np.where(full, rows.cost, np.inf)
    return _Block(
        failing=int((~verify(problem, parameters, trajectory, rows.cost[row, mode]).passed).sum()),
        misfiled=int((filed != mode).sum()),
        killed=int(np.minimum(rows.failures, rows.fallbacks)[present].sum()),
        modes_found=np.bincount(count[present], minlength=modes + 1),
        found=full.sum(axis=0),
        best=np.bincount(cost[count > 0].argmin(axis=1), minlength=modes),
        statuses=np.bincount(rows.status[present], minlength=len(Status)),
        differences=relative_cost_difference(cost[count > 1]),
    )


def contents(database: Database) -> Contents:
    """The statistics of ``database``, of which some thousand instances at a time are read and checked."""
    blocks = [_block(database, where, rows) for where, rows in database.blocks()]
    statuses = np.sum([block.statuses for block in blocks], axis=0)
    return Contents(
        problem=database.problem,
        size=len(database),
        totals=Totals.of(database),
        unsolved={kind.name: int(statuses[kind]) for kind in Status if kind is not Status.SOLVED},
        killed_at_most=sum(block.killed for block in blocks),
        failing=sum(block.failing for block in blocks),
        misfiled=sum(block.misfiled for block in blocks),
        modes_found=np.sum([block.modes_found for block in blocks], axis=0),
        found=np.sum([block.found for block in blocks], axis=0),
        best=np.sum([block.best for block in blocks], axis=0),
        differences=np.concatenate([block.differences for block in blocks]),
        bytes=sum(path.stat().st_size for path in database.path.rglob("*") if path.is_file()),
    )


def accuracy_of(database: Database, cases: int, seed: int = 0) -> Accuracy | None:
    """The accuracy of the best plans of random solved instances; ``None`` without any.

    Args:
        database: the database.
        cases: number of instances.
        seed: of their choice.
    """
    order = np.random.default_rng(seed).permutation(len(database))
    priced = order[np.isfinite(database.costs()[order]).any(axis=1)]
    unfinished = len(priced) - database.totals()["solved"]  # costs that an interrupted chunk left
    samples = database.samples(priced[: cases + unfinished])[:cases]
    return accuracy(database.problem, samples.parameters, samples.trajectory) if len(samples) else None
