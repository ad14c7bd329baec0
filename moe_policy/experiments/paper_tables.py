"""The paper's tables: ways to train, and the summary, a column for each problem and mixture.

Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts* (2019).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.seeds import Range, TrainingRow
from moe_policy.learning.architectures import architecture_of, layer_sizes
from moe_policy.reports.records import Absent, Record, inline, present
from moe_policy.reports.tables import DASH, Column, with_range
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.provenance import Provenance

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class TrainingTable(Record):
    """The paper's table of ways to train, ours next to the paper's: ``table_training.json``."""

    quick: bool  # whether it is made from few instances
    rows: tuple[TrainingRow, ...]  # one for each model
    provenance: Provenance  # of the record


def _error(value: float) -> str:
    """Three decimals; two digits of a value that would be 0.000."""
    return f"{value:.3f}" if value >= 1e-3 else f"{value:.2g}"


def _of_median(form: Callable[[float], str]) -> Callable[[Range], str]:
    return lambda spread: form(spread.median)


#: The table of models: medians over seeds, and their range.
TRAINING_COLUMNS: tuple[Column[TrainingRow], ...] = (
    Column("model", lambda row: row.name),
    Column("training problems", lambda row: row.samples, ","),
    Column("at the goal, within 1 cm", lambda row: row.clear("0.01"), with_range(".0f")),
    Column("… within 5 cm", lambda row: row.clear("0.05"), with_range(".0f")),
    Column("success at the plan's end, median (range)", lambda row: row.success_at_plan_end_spread, with_range(".0f")),
    Column("… after terminal regulation", lambda row: row.success_spread, with_range(".0f")),
    Column("paper", lambda row: row.paper.success, "d"),
    Column("mean violation on the whole path, m", lambda row: row.violation_spread, _of_median("{:.3f}".format)),
    Column("… at the knots", lambda row: row.knot_violation_spread, _of_median("{:.3f}".format)),
    Column("paper", lambda row: row.paper.violation, ".3f"),
    Column("validation error", lambda row: row.validation_error_spread, _of_median(_error)),
    Column("paper", lambda row: row.paper.validation_error, _error),
    Column("test error", lambda row: row.test_error_spread, _of_median("{:.4f}".format)),
)


@dataclass(frozen=True, kw_only=True)
class SummaryColumn(Record):
    """A problem and a mixture."""

    key: str  # of its cells
    title: str  # heading


@dataclass(frozen=True, kw_only=True)
class SummaryRow(Record):
    """One property of all problems and mixtures."""

    label: str  # the property
    cells: dict[str, str] = inline()  # text by the key of the column


@dataclass(frozen=True, kw_only=True)
class SummaryTable(Record):
    """The summary: ``table_summary.json``."""

    quick: bool  # whether it is made from few instances
    columns: tuple[SummaryColumn, ...]  # from left to right
    rows: tuple[SummaryRow, ...]  # from top to bottom
    provenance: Provenance  # of the record


@dataclass(frozen=True, eq=False)
class Source:
    """What the columns of one problem are made from."""

    problem: OptimalControlProblem  # the problem
    rows: Sequence[TrainingRow]  # of its trained models; of equal names the first counts
    cases: int  # number of validation instances


def summarised(problem: OptimalControlProblem) -> list[str]:
    """The mixtures of ``problem`` that have a column in the summary: those whose gate the paper describes."""
    return [name for name, values in benchmark_of(problem).published.items() if values.gate_accuracy is not None]


def summary(sources: Sequence[Source]) -> tuple[tuple[SummaryColumn, ...], tuple[SummaryRow, ...]]:
    """The columns and rows of the summary of ``sources``, one for each problem, in the order of their columns."""
    columns, cells = [], {}
    for source in sources:
        env_id, models = source.problem.id, {row.name: row for row in reversed(source.rows)}
        for name in summarised(source.problem):
            key = f"{env_id} {name}"
            columns.append(SummaryColumn(key=key, title=f"{env_id}, {name}"))
            cells[key] = _cells(source, models["snn"], models[name])
    labels = next(iter(cells.values()))
    rows = (SummaryRow(label=label, cells={key: texts[label] for key, texts in cells.items()}) for label in labels)
    return tuple(columns), tuple(rows)


def summary_columns(columns: Sequence[SummaryColumn]) -> tuple[Column[SummaryRow], ...]:
    """The columns of the table of a summary with these ``columns``."""
    return Column("ours (paper)", lambda row: row.label), *(Column(c.title, partial(_cell, c.key)) for c in columns)


def _cell(key: str, row: SummaryRow) -> str:
    return row.cells[key]


def _cells(source: Source, single: TrainingRow, mixture: TrainingRow) -> dict[str, str]:
    """The texts of one column by their label."""
    problem, cases = source.problem, source.cases
    splits = {name: f"{len(sets_of(problem).split(name)):,}" for name in ("training", "validation")}
    return {
        "states, controls": f"{problem.system.nx}, {problem.system.nu}",
        "parameters": ", ".join(problem.parameters.names),
        "range": _box(problem),
        "training problems": f"{single.samples:,} ({splits['training']})",
        "validation problems": f"{cases:,} ({splits['validation']})",
        "SNN size": str(layer_sizes(problem, architecture_of(problem).single)),
        "SNN test error": _medians(single.test_error_spread, single.paper.test_error),
        "SNN validation error": _medians(single.validation_error_spread, single.paper.validation_error),
        "SNN rollout": _rollout(single, cases),
        **_clusters(problem, mixture),
        "MoE validation error": _medians(mixture.validation_error_spread, mixture.paper.validation_error),
        "MoE rollout": _rollout(mixture, cases),
    }


def _clusters(problem: OptimalControlProblem, mixture: TrainingRow) -> dict[str, str]:
    """The texts about the gate and the experts of the first seed."""
    sizes, paper = architecture_of(problem), mixture.paper
    clusters, accuracy = _first(mixture.cluster_sizes), _first(mixture.gate_accuracy)
    experts = np.array(_first(mixture.part_test_errors))
    method = "custom" if mixture.name == "moe-custom" else "k-means"
    average = float(np.mean(clusters))
    hidden = sorted({sizes.expert(size, average, method.replace("-", "")) for size in clusters})
    return {
        "clusters": f"{len(clusters)}, {method}",
        "cluster sizes": _beside(_extent, clusters, paper.cluster_sizes),
        "gate size": str(layer_sizes(problem, sizes.gate, len(clusters))),
        "gate test accuracy": _beside(lambda value: f"{100 * value:.1f} %", accuracy, paper.gate_accuracy),
        "expert size": ", ".join(str(layer_sizes(problem, layers)) for layers in hidden),
        "expert test error": _beside(
            lambda value: f"{value[0]:.2g} ± {value[1]:.2g}", (experts.mean(), experts.std()), paper.expert_test_error
        ),
    }


def _first(values: tuple[T | None, ...] | Absent) -> T:
    """The value of the first seed of a mixture.

    Raises:
        ValueError: a record without it.
    """
    known = present(values)
    if not known or known[0] is None:
        raise ValueError(
            f"got {values}, expected a value of a mixture; train it again with scripts/compare_training.py"
        )
    return known[0]


def _box(problem: OptimalControlProblem) -> str:
    """The parameter box, equal intervals in succession as powers."""
    box = problem.parameters
    intervals = itertools.groupby(f"[{a:.3g}, {b:.3g}]" for a, b in zip(box.lower, box.upper))
    powers = [(text, len(list(same))) for text, same in intervals]
    return " × ".join(text if power == 1 else f"{text}^{power}" for text, power in powers)


def _extent(sizes: Sequence[int]) -> str:
    return f"{min(sizes):,}–{max(sizes):,}"


def _beside(form: Callable[[T], str], ours: T, paper: T | Absent) -> str:
    """``ours`` in the given form, with the paper's value in brackets."""
    known = present(paper)
    return f"{form(ours)} ({DASH if known is None else form(known)})"


def _medians(ours: Range, paper: float | Absent) -> str:
    return _beside("{:.2g}".format, ours.median, paper)


def _rollout(row: TrainingRow, cases: int) -> str:
    """Successes, or where the paper gives it the mean violation at the knots in metres."""
    violation, paper = present(row.knot_violation_spread), present(row.paper.violation)
    if violation is not None and paper is not None:
        return f"−{violation.median:.3f} m (−{paper:.3f} m)"
    success = present(row.paper.success)
    return f"{row.success_spread.median:.0f} of {cases:,} ({DASH if success is None else success})"
