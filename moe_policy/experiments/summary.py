"""Records of trained models, over seeds, and the paper's two tables made of them.

The tables are those of Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts* (2019):
``training`` compares ways to train on the pendulum, ``summary`` has a column for each problem and clustering.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from moe_policy.experiments import comparison
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.methods import Method
from moe_policy.experiments.tables import DASH, Column, keyed
from moe_policy.learning.architectures import architecture_of, layer_sizes
from moe_policy.planners.network import NetworkPlanner
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.splits import sets_of

Record = dict[str, Any]
_MEASURED = ("success", "success_at_plan_end", "violation", "knot_violation", "test_error", "validation_error")


def training_record(planner: NetworkPlanner) -> Record:
    """How a network was trained, as JSON."""
    training = planner.details["training"]
    parts = training["parts"]
    return {
        "seed": planner.details["seed"],
        "samples": planner.details["samples"],
        "test_error": training["test_error"],
        "training_seconds": training["seconds"],
        "peak_memory_gb": training.get("peak_memory_gb"),
        "gate_accuracy": next((part["accuracy"] for part in parts if part["accuracy"] is not None), None),
        "part_test_errors": [part["test_loss"] for part in parts if part["accuracy"] is None],
        "cluster_sizes": planner.details.get("clusters", {}).get("sizes"),
    }


def model_record(planner: NetworkPlanner, validation: Samples) -> Record:
    """:func:`training_record`, and what the network does on solved validation problems."""
    problem = planner.problem
    method = Method(planner.name, planner)
    row, _ = comparison.run(problem, method, validation.parameters, optimal=validation.trajectory, batches=())
    at_end = row.metrics.success_at_plan_end
    assert at_end is not None
    return training_record(planner) | {
        "success": row.metrics.success.count,
        "success_at_plan_end": at_end.count,
        "reached": row.metrics.reached.count,
        "violation": row.metrics.violation_mean,
        "knot_violation": row.metrics.knot_violation_mean,
        "validation_error": row.validation_error,
    }


def row_of(name: str, records: Sequence[Record], published: Published | None = None) -> Record:
    """One row of a table: the records of a model's seeds as lists, medians with their range, and the paper's figures.

    Args:
        name: of the row.
        records: of :func:`model_record`, one a seed, all from as many samples.
        published: the paper's figures, kept as ``paper_...``.
    """
    row: Record = {"name": name, "samples": records[0]["samples"]}
    for key in records[0].keys() - {"samples"}:
        row[f"{key}s" if key == "seed" else key] = [r.get(key) for r in records]
    for key in (*_MEASURED, "training_seconds"):
        values = row.get(key, [None])
        if values[0] is not None:
            row[f"{key}_spread"] = {"median": float(np.median(values)), "least": min(values), "most": max(values)}
    return row if published is None else beside_published(row, published)


def beside_published(row: Record, published: Published) -> Record:
    """``row`` with the paper's figures, as ``paper_...``."""
    figures = dataclasses.asdict(published)
    return row | {f"paper_{key}": value for key, value in figures.items() if value is not None}


# -- the summary -------------------------------------------------------------------------------------------------------


def summarised(problem: OptimalControlProblem) -> list[str]:
    """The mixtures of ``problem`` that have a column in the summary: those whose gate the paper describes."""
    return [name for name, figures in benchmark_of(problem).published.items() if figures.gate_accuracy is not None]


def summary_record(
    problems: Sequence[OptimalControlProblem], rows: Mapping[str, Sequence[Record]], cases: Mapping[str, int]
) -> Record:
    """The summary as JSON: ``columns`` (title and key of each) and ``rows`` of texts, ours with the paper's beside it.

    Args:
        problems: in the order of their columns.
        rows: of :func:`row_of`, by id of the problem; the first of a name counts.
        cases: number of validation problems that they were judged on, by id of the problem.
    """
    columns, cells = [], []
    for problem in problems:
        models: dict[str, Record] = {}
        for row in rows[problem.id]:
            models.setdefault(row["name"], row)
        for name in summarised(problem):
            key = f"{problem.id} {name}"
            columns.append({"key": key, "title": f"{problem.id}, {name}"})
            cells.append((key, _cells(problem, models["snn"], models[name], cases[problem.id])))
    labels = list(cells[0][1])
    return {"columns": columns, "rows": [{"label": text} | {key: of[text] for key, of in cells} for text in labels]}


def summary_columns(record: Mapping[str, Any]) -> tuple[Column, ...]:
    """The columns of a summary's table."""
    return keyed("label", "ours (paper)"), *(keyed(column["key"], column["title"]) for column in record["columns"])


def _cells(problem: OptimalControlProblem, single: Record, mixture: Record, cases: int) -> dict[str, str]:
    """The texts of one column by their label."""
    sizes, name = architecture_of(problem), mixture["name"]
    clusters = mixture["cluster_sizes"][0]
    method = "custom" if name == "moe-custom" else "k-means"
    average = float(np.mean(clusters))
    hidden = sorted({sizes.expert(size, average, method.replace("-", "")) for size in clusters})
    experts = np.array(mixture["part_test_errors"][0])
    paper = mixture.get("paper_expert_test_error")
    validation = sets_of(problem).validation
    return {
        "states, controls": f"{problem.system.nx}, {problem.system.nu}",
        "parameters": ", ".join(problem.parameters.names),
        "range": _box(problem),
        "training problems": _beside(f"{single['samples']:,}", f"{len(sets_of(problem).training):,}"),
        "validation problems": _beside(f"{cases:,}", f"{len(validation):,}"),
        "SNN size": str(layer_sizes(problem, sizes.single)),
        "SNN test error": _figure(single, "test_error"),
        "SNN validation error": _figure(single, "validation_error"),
        "SNN rollout": _rollout(single, cases),
        "clusters": f"{len(clusters)}, {method}",
        "cluster sizes": _beside(_range(clusters), _range(mixture.get("paper_cluster_sizes"))),
        "gate size": str(layer_sizes(problem, sizes.gate, len(clusters))),
        "gate test accuracy": _beside(
            _percent(mixture["gate_accuracy"][0]), _percent(mixture.get("paper_gate_accuracy"))
        ),
        "expert size": ", ".join(str(layer_sizes(problem, layers)) for layers in hidden),
        "expert test error": _beside(
            f"{experts.mean():.2g} ± {experts.std():.2g}",
            DASH if paper is None else f"{paper[0]:.2g} ± {paper[1]:.2g}",
        ),
        "MoE validation error": _figure(mixture, "validation_error"),
        "MoE rollout": _rollout(mixture, cases),
    }


def _box(problem: OptimalControlProblem) -> str:
    """The parameter box, intervals that repeat as powers."""
    box = problem.parameters
    intervals = itertools.groupby(f"[{a:.3g}, {b:.3g}]" for a, b in zip(box.lower, box.upper))
    powers = [(text, len(list(same))) for text, same in intervals]
    return " × ".join(text if power == 1 else f"{text}^{power}" for text, power in powers)


def _beside(ours: str, papers: str) -> str:
    return f"{ours} ({papers})"


def _number(value: float | None) -> str:
    return DASH if value is None else f"{value:.2g}"


def _percent(value: float | None) -> str:
    return DASH if value is None else f"{100 * value:.1f} %"


def _range(sizes: Sequence[int] | None) -> str:
    return DASH if sizes is None else f"{min(sizes):,}–{max(sizes):,}"


def _figure(row: Record, key: str) -> str:
    return _beside(_number(row[f"{key}_spread"]["median"]), _number(row.get(f"paper_{key}")))


def _rollout(row: Record, cases: int) -> str:
    """Successes, or where the paper counts it the mean violation at the knots in metres."""
    if "paper_violation" in row:
        return _beside(f"−{row['knot_violation_spread']['median']:.3f} m", f"−{row['paper_violation']:.3f} m")
    return _beside(f"{row['success_spread']['median']:.0f} of {cases:,}", f"{row.get('paper_success', DASH)}")
