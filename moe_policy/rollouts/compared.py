"""What a comparison of planners found, as a value and as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from moe_policy.protocols import Planner
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import TOLERANCES, Metrics
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.doors import checked


@checked
@dataclass(frozen=True, eq=False)
class Comparison:
    """Planners for ``problem``, compared on test instances.

    Args:
        problem: the problem.
        planners: the planners by name, in the order of the table; the tracked optimum is the first.
        metrics: the metrics of each planner on the test instances, by name; costs are relative to the tracked optimum.
        development: how many development instances each trained planner led to the goal at its plan's end, clear of
            constraints; by name.
        best: name of the trained planner that is chosen on the development instances, one that needs no solver.
        sizes: numbers of samples to learn from, of development and of test instances.
    """

    problem: OptimalControlProblem
    planners: Mapping[str, Planner]
    metrics: Mapping[str, Metrics]
    development: Mapping[str, int]
    best: str
    sizes: tuple[int, int, int]

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(self.planners)} on {self.problem.id!r}: {self.best} is best>"

    def __str__(self) -> str:
        learnt, chosen, tested = self.sizes
        last = (
            f"{tested} test instances; {learnt} to learn from; {self.best} is the best of the trained ones on {chosen} "
            "development instances"
        )
        return f"{self.table}\n\n{last}"

    @property
    def table(self) -> str:
        """The metrics in Markdown, a line for each planner."""
        first = next(iter(self.metrics.values()))
        columns: dict[str, Callable[[Metrics], str]] = {"success at the plan's end": lambda m: _share(_at_end(m))}
        if self.problem.hold > 0:
            columns["… after terminal regulation"] = lambda m: _share(m.success)
        columns["cost / optimal"] = _relative_cost
        if first.success_clear is not None:
            columns |= {
                f"success, clear within {tolerance:g}": partial(_clear, tolerance=f"{tolerance:g}")
                for tolerance in TOLERANCES
            }
            columns["mean violation"] = lambda m: "–" if m.violation is None else f"{m.violation.mean.mean:.3g}"
        columns["left the box"] = lambda m: str(m.left_box)
        rows = [["planner", *columns], *([name, *(c(m) for c in columns.values())] for name, m in self.metrics.items())]
        return _markdown(rows)


def _at_end(metrics: Metrics) -> Proportion:
    return metrics.success if metrics.success_at_plan_end is None else metrics.success_at_plan_end


def _clear(metrics: Metrics, tolerance: str) -> str:
    return _share(None if metrics.success_clear is None else metrics.success_clear[tolerance])


def _share(part: Proportion | None) -> str:
    return "–" if part is None else f"{part.count} of {part.total}"


def _relative_cost(metrics: Metrics) -> str:
    if metrics.cost_ratio is None or metrics.cost_ratio.ratio is None:
        return "–"
    return f"{metrics.cost_ratio.ratio:.3f} ({metrics.cost_ratio.episodes})"


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths)) + " |" for row in rows]
    return "\n".join([lines[0], "| " + " | ".join("-" * width for width in widths) + " |", *lines[1:]])
