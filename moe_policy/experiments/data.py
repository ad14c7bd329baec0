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
from ocp_envs.support.progress import Progress


@dataclass(frozen=True, eq=False)
class Contents:
    """What a database holds."""

    report: SplitReport  # its record
    differences: Array  # (second − best) / |best| of the instances with at least two families


def _block(database: Database, where: slice, rows: StoredRows) -> tuple[dict[str, Ints], Array]:
    """Counts of ``rows``, by number of families, by family or by :class:`Status`, and relative cost differences."""
    problem, modes = database.problem, len(database.problem.modes)
    present, full = rows.present, rows.found
    row, mode = np.nonzero(full)
    trajectory, parameters = problem.unflatten(rows.z[row, mode]), database.stored_parameters(where)[row]
    filed = problem.modes.of(problem, parameters, trajectory, rows.multipliers[row, mode])
    count, cost = full.sum(axis=1), np.where(full, rows.cost, np.inf)
    counts = {
        "failing": (~verify(problem, parameters, trajectory, rows.cost[row, mode]).passed).sum(),
        "misfiled": (filed != mode).sum(),
        "killed": np.minimum(rows.failures, rows.fallbacks)[present].sum(),
        "modes_found": np.bincount(count[present], minlength=modes + 1),
        "found": full.sum(axis=0),
        "best": np.bincount(cost[count > 0].argmin(axis=1), minlength=modes),
        "statuses": np.bincount(rows.status[present], minlength=len(Status)),
    }
    return counts, relative_cost_difference(cost[count > 1])


def contents(database: Database, accuracy: Accuracy | None = None) -> Contents:
    """The statistics of ``database``, read and checked in blocks, with the ``accuracy`` of some of its plans."""
    blocks = []
    with Progress(len(database), unit="instance", label=f"check of {database.path.stem}", leave=False) as shown:
        for where, rows in database.blocks():
            blocks.append(_block(database, where, rows))
            shown.update(where.stop - where.start)
    counts = {name: np.sum([block[name] for block, _ in blocks], axis=0).tolist() for name in blocks[0][0]}
    totals, differences = Totals.of(database), np.concatenate([block for _, block in blocks])
    families = zip(database.problem.modes.names, counts["found"], counts["best"])
    report = SplitReport(
        size=len(database),
        totals=totals,
        solves_per_problem=totals.solves / max(totals.problems, 1),
        iterations_per_solve=totals.iterations / max(totals.solves, 1),
        # It is not stored how solves failed, but known where none did.
        failures_by_kind=None if totals.failures else {kind.name: 0 for kind in FAILURES},
        killed_at_most=counts["killed"],
        unsolved={kind.name: counts["statuses"][kind] for kind in Status if kind is not Status.SOLVED},
        trajectories=sum(counts["found"]),
        failing=counts["failing"],
        misfiled=counts["misfiled"],
        modes_found=tuple(counts["modes_found"]),
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
