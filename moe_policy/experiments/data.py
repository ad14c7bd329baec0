"""What a database holds: statistics, with every stored trajectory checked again.

A database stores *how many* solves of an instance failed, not how each of them ended, so this is not reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.experiments.data_report import FAILURES, AccuracyReport, CostDifferences, FamilyRow, SplitReport
from moe_policy.experiments.generation import Totals
from ocp_envs.data.database import Database
from ocp_envs.data.layout import StoredRows
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.solvers.accuracy import Accuracy, accuracy
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Ints


@dataclass(frozen=True, eq=False)
class Contents:
    """What a database holds."""

    report: SplitReport  # its record
    differences: Array  # (second − best) / |best| of the instances with at least two families


@dataclass(frozen=True, eq=False)
class _Block:
    """Statistics of some rows: arrays count instances by number of families, by family and by :class:`Status`."""

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


def contents(database: Database, accuracy: Accuracy | None = None) -> Contents:
    """The statistics of ``database``, read and checked in blocks, with the ``accuracy`` of some of its plans."""
    blocks = [_block(database, where, rows) for where, rows in database.blocks()]
    modes_found, found, best, statuses = (
        np.sum([getattr(block, name) for block in blocks], axis=0).tolist()
        for name in ("modes_found", "found", "best", "statuses")
    )
    totals, differences = Totals.of(database), np.concatenate([block.differences for block in blocks])
    families = zip(database.problem.modes.names, found, best)
    report = SplitReport(
        size=len(database),
        totals=totals,
        solves_per_problem=totals.solves / max(totals.problems, 1),
        iterations_per_solve=totals.iterations / max(totals.solves, 1),
        # It is not stored how solves failed, but known where none did.
        failures_by_kind=None if totals.failures else {kind.name: 0 for kind in FAILURES},
        killed_at_most=sum(block.killed for block in blocks),
        unsolved={kind.name: statuses[kind] for kind in Status if kind is not Status.SOLVED},
        trajectories=sum(found),
        failing=sum(block.failing for block in blocks),
        misfiled=sum(block.misfiled for block in blocks),
        modes_found=tuple(modes_found),
        families=tuple(
            FamilyRow(mode=name, found=n, best=cheapest, share=cheapest / max(totals.solved, 1))
            for name, n, cheapest in families
        ),
        differences=CostDifferences.of(differences),
        bytes=sum(path.stat().st_size for path in database.path.rglob("*") if path.is_file()),
        accuracy=None if accuracy is None else AccuracyReport.from_json(accuracy.record()),
        settings=database.settings,
    )
    return Contents(report, differences)


def accuracy_of(database: Database, cases: int, seed: int = 0) -> Accuracy | None:
    """The accuracy of the best plans of random solved instances, ``cases`` of them; ``None`` without any."""
    order = np.random.default_rng(seed).permutation(len(database))
    priced = order[np.isfinite(database.costs()[order]).any(axis=1)]
    unfinished = len(priced) - database.totals()["solved"]  # costs that an interrupted chunk left
    samples = database.samples(priced[: cases + unfinished])[:cases]
    return accuracy(database.problem, samples.parameters, samples.trajectory) if len(samples) else None
