"""Write the tables of the pages from the records in ``results/``; ``--check`` only tells whether they agree.

A table stands between ``<!-- table: NAME -->`` and ``<!-- end -->`` and is made from ``results/NAME.json``, or from a
part of it: ``<!-- table: NAME PART -->``. A table of scores is made from all of ``results/score_*_<env>.json``.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from moe_policy.experiments import cli
from moe_policy.experiments.between_knots import COLUMNS as BETWEEN_KNOTS_COLUMNS
from moe_policy.experiments.between_knots import BetweenKnots
from moe_policy.experiments.borders import BORDER_COLUMNS, Borders
from moe_policy.experiments.budgets import BUDGET_COLUMNS, Budgets
from moe_policy.experiments.checking import PlannerChecks
from moe_policy.experiments.checking_tables import (
    BOUND_COLUMNS,
    CHECK_COLUMNS,
    REPAIR_COLUMNS,
    TIME_COLUMNS,
    checked_lines,
    repair_lines,
)
from moe_policy.experiments.cluster_choice import CLUSTER_COLUMNS, ClusterChoice
from moe_policy.experiments.comparison import COLUMNS, Comparison, Sensitivity
from moe_policy.experiments.demonstrations import CLONE_COLUMNS, DATASET_COLUMNS, Datasets
from moe_policy.experiments.discretisation import COLUMNS as DISCRETISATION_COLUMNS
from moe_policy.experiments.discretisation import Discretisation
from moe_policy.experiments.families import FAMILY_COLUMNS, FamiliesTable
from moe_policy.experiments.latency import PLANNING_COLUMNS, Latency, planning_rows
from moe_policy.experiments.learners import TRIAL_COLUMNS, Search
from moe_policy.experiments.overview import OVERVIEW_COLUMNS, OverviewTable
from moe_policy.experiments.paper_tables import TRAINING_COLUMNS, SummaryTable, TrainingTable, summary_columns
from moe_policy.experiments.partitions import PARTITION_COLUMNS, Partitions
from moe_policy.experiments.replanning import REPLANNING_COLUMNS, ReplanningRecord
from moe_policy.experiments.seeds import TrainingComparison
from moe_policy.experiments.speed.guesses import SOLVER_COLUMNS
from moe_policy.experiments.speed.solver import SPEED_COLUMNS, SolverSpeed, lines_of
from moe_policy.experiments.splits import SplitComparison, lines
from moe_policy.reports.records import Record, read
from moe_policy.reports.split_table import SPLIT_COLUMNS
from moe_policy.reports.tables import Column, markdown_table
from moe_policy.score import scoring

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "results/README.md")
BLOCK = re.compile(r"(<!-- table: (\S+)(?: (\w+))? -->\n).*?(<!-- end -->)", re.DOTALL)
R = TypeVar("R", bound=Record)
Row = TypeVar("Row")


def table(kind: type[R], rows: Callable[[R], Sequence[Row]], columns: Sequence[Column[Row]]) -> Callable[[Path], str]:
    """Path of a record of type ``kind`` → the table of its ``rows``."""
    return lambda path: markdown_table(rows(read(path, kind)), columns)


def summary(path: Path) -> str:
    found = read(path, SummaryTable)
    return markdown_table(found.rows, summary_columns(found.columns))


#: Makes a table by the name of its record without the environment, and the part of it.
TABLES: dict[tuple[str, str | None], Callable[[Path], str]] = {
    ("table_overview", None): table(OverviewTable, lambda record: record.rows, OVERVIEW_COLUMNS),
    ("table_summary", None): summary,
    ("table_families", None): table(FamiliesTable, lambda record: record.rows, FAMILY_COLUMNS),
    ("table_training", None): table(TrainingTable, lambda record: record.rows, TRAINING_COLUMNS),
    ("compare", None): table(Comparison, lambda record: record.rows, COLUMNS),
    ("compare_training", None): table(TrainingComparison, lambda record: record.rows, TRAINING_COLUMNS),
    ("compare_splits", None): table(SplitComparison, lines, SPLIT_COLUMNS),
    ("planners_checked", None): table(PlannerChecks, checked_lines, CHECK_COLUMNS),
    ("planners_checked", "repaired"): table(PlannerChecks, repair_lines, REPAIR_COLUMNS),
    ("planners_checked", "times"): table(PlannerChecks, lambda record: record.times, TIME_COLUMNS),
    ("planners_checked", "bounds"): table(PlannerChecks, lambda record: record.bounds, BOUND_COLUMNS),
    ("replanning", None): table(ReplanningRecord, lambda record: record.rows, REPLANNING_COLUMNS),
    ("partitions", None): table(Partitions, lambda record: record.rows, PARTITION_COLUMNS),
    ("borders", None): table(Borders, lambda record: record.rows, BORDER_COLUMNS),
    ("clusters", None): table(ClusterChoice, lambda record: record.rows, CLUSTER_COLUMNS),
    ("between_knots", None): table(BetweenKnots, lambda record: record.rows, BETWEEN_KNOTS_COLUMNS),
    ("discretisation", None): table(Discretisation, lambda record: record.rows, DISCRETISATION_COLUMNS),
    ("sensitivity", None): table(Sensitivity, lambda record: record.rows, COLUMNS),
    ("stabiliser", None): table(Sensitivity, lambda record: record.rows, COLUMNS),
    ("minari", None): table(Datasets, lambda record: record.rows, DATASET_COLUMNS),
    ("minari", "clones"): table(Datasets, lambda record: record.clones, CLONE_COLUMNS),
    ("budgets", None): table(Budgets, lambda record: record.relative().rows, BUDGET_COLUMNS),
    **{
        (f"search_{name}", None): table(Search, lambda record: record.trials, TRIAL_COLUMNS)
        for name in ("bc", "ppo", "ppo-bc")
    },
    ("benchmark_solver", None): table(SolverSpeed, lines_of, SPEED_COLUMNS),
    ("benchmark_planning", "planning"): table(Latency, planning_rows, PLANNING_COLUMNS),
    ("benchmark_planning", "solver"): table(Latency, lambda record: record.solver, SOLVER_COLUMNS),
}


def table_of(name: str, part: str | None) -> str:
    if name.startswith("score_"):
        return scoring.table([read(path, scoring.Score) for path in sorted((ROOT / "results").glob(f"{name}.json"))])
    kind = name if name.startswith("table_") or "_" not in name else name.rpartition("_")[0]
    return TABLES[kind, part](ROOT / "results" / f"{name}.json")


def render(text: str) -> str:
    def table(block: re.Match[str]) -> str:
        return f"{block[1]}\n{table_of(block[2], block[3])}\n{block[4]}"

    return BLOCK.sub(table, text)


def main() -> int:
    parser = cli.parser(__doc__, env=None, results=False)
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if a page differs")
    arguments = parser.parse()
    differ = False
    for path in (ROOT / page for page in PAGES):
        old = path.read_text(encoding="utf-8")
        new = render(old)
        differ |= old != new
        if not arguments.check:
            path.write_text(new, encoding="utf-8")
    return int(arguments.check and differ)


if __name__ == "__main__":
    cli.run(main)
