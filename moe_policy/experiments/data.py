"""What a database holds: statistics, with every stored trajectory checked anew, and a figure.

What a database does not store cannot be reported: it keeps *how many* solves of a problem failed, not how each ended.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.experiments.figures.style import COLORS, save_figure
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.solvers.accuracy import Accuracy, accuracy
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Ints

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Gaps below which two modes count as close.
CLOSE = (0.001, 0.01, 0.03)
_BINS_PER_DECADE = 5
#: Levels of the quantiles that are reported.
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
#: The ways in which a solve fails.
FAILURES = (Status.NOT_CONVERGED, Status.TIMED_OUT, Status.CRASHED, Status.CHECK_FAILED)


# -- statistics --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Contents:
    """What a database holds.

    Args:
        problem: the problem.
        size: problems it was made for.
        totals: sums over the problems that are there, as of :meth:`Database.totals`.
        unsolved: problems without any trajectory, by how their first solve ended.
        killed_at_most: solves that ended in a time-out or a crash: each is a failure, and went to the fallback.
        failing: stored trajectories that fail the independent check.
        misfiled: stored trajectories of another mode than that of their slot.
        modes_found: number of problems in which 0, 1, … modes were found, (modes + 1,).
        found, best: number of problems in which a mode was found, and in which it is the cheapest, (modes,).
        gaps: (second best − best) / |best| of the problems with at least two modes.
        bytes: size of the files.
    """

    problem: OptimalControlProblem
    size: int
    totals: Mapping[str, int]
    unsolved: Mapping[str, int]
    killed_at_most: int
    failing: int
    misfiled: int
    modes_found: Ints
    found: Ints
    best: Ints
    gaps: Array
    bytes: int

    @property
    def trajectories(self) -> int:
        """Number of trajectories that are stored."""
        return int(self.found.sum())

    @property
    def failures_by_kind(self) -> dict[str, int] | None:
        """Failed solves by how they ended; ``None`` where that is not stored, which it is only if there are none."""
        return None if self.totals["failures"] else {kind.name: 0 for kind in FAILURES}

    def record(self) -> dict[str, Any]:
        """As JSON."""
        totals, solved = self.totals, max(self.totals["solved"], 1)
        return {
            "size": self.size,
            **totals,
            "solves_per_problem": totals["solves"] / max(totals["problems"], 1),
            "iterations_per_solve": totals["iterations"] / max(totals["solves"], 1),
            "failures_by_kind": self.failures_by_kind,
            "timed_out_or_crashed_at_most": self.killed_at_most,
            "unsolved_by_first_solve": dict(self.unsolved),
            "trajectories": self.trajectories,
            "failing_the_check": self.failing,
            "in_the_slot_of_another_mode": self.misfiled,
            "modes_found": self.modes_found,
            "classes": [
                {"mode": name, "found": found, "best": best, "share": best / solved}
                for name, found, best in zip(self.problem.modes.names, self.found.tolist(), self.best.tolist())
            ],
            "gap": self._gap_record(),
            "bytes": self.bytes,
        }

    def _gap_record(self) -> dict[str, Any]:
        if not len(self.gaps):
            return {"problems": 0, "quantiles": None, "share_below": None}
        return {
            "problems": len(self.gaps),
            "quantiles": {f"{level:g}": float(np.quantile(self.gaps, level)) for level in LEVELS},
            "share_below": {f"{limit:g}": float((self.gaps < limit).mean()) for limit in CLOSE},
        }


def contents(database: Database) -> Contents:
    """The statistics of ``database``, every stored trajectory checked anew; some thousand problems are in memory."""
    problem, modes = database.problem, len(database.problem.modes)
    failing = misfiled = killed = 0
    modes_found, best = np.zeros(modes + 1, np.int64), np.zeros(modes, np.int64)
    found, statuses, gaps = best.copy(), np.zeros(len(Status), np.int64), [np.empty(0)]
    for where, rows in database.blocks():
        there, full = rows.present, rows.found
        row, mode = np.nonzero(full)
        trajectory = problem.unflatten(rows.z[row, mode])
        parameters = database.stored_parameters(where)[row]
        failing += int((~verify(problem, parameters, trajectory, rows.cost[row, mode]).passed).sum())
        filed = problem.modes.classify(problem, parameters, trajectory, rows.multipliers[row, mode])
        misfiled += int((filed != mode).sum())
        killed += int(np.minimum(rows.failures, rows.fallbacks)[there].sum())
        count = full.sum(axis=1)
        modes_found += np.bincount(count[there], minlength=modes + 1)
        found += full.sum(axis=0)
        statuses += np.bincount(rows.status[there], minlength=len(Status))
        cost = np.where(full, rows.cost, np.inf)
        best += np.bincount(cost[count > 0].argmin(axis=1), minlength=modes)
        gaps.append(relative_cost_difference(cost[count > 1]))
    return Contents(
        problem=problem,
        size=len(database),
        totals=database.totals(),
        unsolved={kind.name: int(statuses[kind]) for kind in Status if kind is not Status.SOLVED},
        killed_at_most=killed,
        failing=failing,
        misfiled=misfiled,
        modes_found=modes_found,
        found=found,
        best=best,
        gaps=np.concatenate(gaps),
        bytes=sum(path.stat().st_size for path in database.path.rglob("*") if path.is_file()),
    )


def accuracy_of(database: Database, cases: int, seed: int = 0) -> Accuracy | None:
    """The accuracy of the best plans of ``cases`` random solved problems of ``database``; ``None`` if it has none."""
    order = np.random.default_rng(seed).permutation(len(database))
    priced = order[np.isfinite(database.costs()[order]).any(axis=1)]
    unfinished = len(priced) - database.totals()["solved"]  # costs that an interrupted chunk has left
    samples = database.samples(priced[: cases + unfinished])[:cases]
    return accuracy(database.problem, samples.parameters, samples.trajectory) if len(samples) else None


# -- figure ------------------------------------------------------------------------------------------------------------


#: By split, what its database holds and the accuracy of its plans.
Reports = Mapping[str, tuple[Contents, Accuracy | None]]


def data_figure(path: str | os.PathLike[str], reports: Reports) -> Path:
    """Class shares, modes found, gaps between modes and accuracy, one colour for each split, saved as PNG."""

    def draw(figure: Figure) -> None:
        (classes, modes), (gaps, errors) = figure.subplots(2, 2)
        _draw_classes(classes, reports)
        _draw_modes(modes, reports)
        _draw_gaps(gaps, reports)
        _draw_accuracy(errors, reports)
        figure.legend(*classes.get_legend_handles_labels(), loc="outside lower center", ncols=len(reports))

    return save_figure(path, (10.0, 7.0), draw)


def _offsets(count: int) -> tuple[Array, float]:
    """Places of ``count`` bars around a tick, and their width."""
    width = 0.8 / count
    return np.asarray((np.arange(count) - (count - 1) / 2) * width, dtype=np.float64), width


def _draw_classes(axes: Axes, reports: Reports) -> None:
    shifts, width = _offsets(len(reports))
    for i, (name, (held, _)) in enumerate(reports.items()):
        solved = held.totals["solved"]
        places = np.arange(len(held.best)) + shifts[i]
        label = f"{name}: {solved:,} solved problems"
        axes.barh(places, 100 * held.best / max(solved, 1), width, color=COLORS[i], label=label)
        axes.set_yticks(range(len(held.best)), held.problem.modes.names)
    axes.invert_yaxis()
    axes.set(xlabel="solved problems, %", title="share of each class: the mode that is cheapest")


def _draw_modes(axes: Axes, reports: Reports) -> None:
    shifts, width = _offsets(len(reports))
    for i, (held, _) in enumerate(reports.values()):
        share = 100 * held.modes_found / max(held.totals["problems"], 1)
        axes.bar(np.arange(len(share)) + shifts[i], share, width, color=COLORS[i])
        axes.set_xticks(range(len(share)))
    axes.set(xlabel="modes found", ylabel="problems, %", title="modes found for a problem")


def _draw_histograms(axes: Axes, values: Mapping[tuple[int, str], Array], lowest: float) -> None:
    """Shares on a logarithmic axis, by colour and line style; what is below ``lowest`` is in the first bin."""
    every = np.concatenate([np.empty(0), *values.values()])
    if not len(every):
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center")
        return
    low, high = (np.log10(np.maximum(limit, lowest)) for limit in (every.min(), every.max()))
    first, last = np.floor(low), max(np.ceil(high), np.floor(low) + 1)
    edges = np.logspace(first, last, _BINS_PER_DECADE * int(last - first) + 1)
    for (i, line), part in values.items():
        counts, _ = np.histogram(np.clip(part, edges[0], edges[-1]), edges)
        axes.stairs(100 * counts / max(len(part), 1), edges, color=COLORS[i], linestyle=line, linewidth=1.4)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)


def _draw_gaps(axes: Axes, reports: Reports) -> None:
    _draw_histograms(axes, {(i, "-"): held.gaps for i, (held, _) in enumerate(reports.values())}, 1e-6)
    for limit in CLOSE:
        axes.axvline(limit, color="black", linestyle=":", linewidth=0.8)
    axes.set(
        xlabel="(second best − best) / best; dotted: 0.1 %, 1 %, 3 %",
        ylabel="problems with two modes or more, %",
        title="cost gap between the best two modes",
    )


def _draw_accuracy(axes: Axes, reports: Reports) -> None:
    kinds = (("interval", ":", "per interval"), ("open_loop", "-", "open loop, x_0 to t_f"))
    values = {
        (i, line): found.errors(kind, scaled=True)
        for i, (_, found) in enumerate(reports.values())
        if found is not None
        for kind, line, _ in kinds
    }
    _draw_histograms(axes, values, 1e-10)
    for _, line, label in kinds:
        axes.plot([], [], line, color="#555555", label=label)
    axes.set_ylim(top=1.12 * axes.get_ylim()[1])  # room for the legend
    axes.legend(loc="upper center", ncols=2, fontsize=8)
    axes.set(
        xlabel="state error, scaled; first bin: and all below",
        ylabel="intervals or plans, %",
        title="accuracy against the true equation",
    )
