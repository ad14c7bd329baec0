"""Write the tables of the pages from the records in ``results/``; ``--check`` only tells whether they agree.

A table stands between ``<!-- table: NAME -->`` and ``<!-- end -->`` and is made from ``results/NAME.json``, or from a
part of it: ``<!-- table: NAME PART -->``.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from moe_policy.experiments.budgets import BUDGET_COLUMNS, Budgets
from moe_policy.experiments.comparison import COLUMNS, TRAINING_COLUMNS, Comparison, Sensitivity
from moe_policy.experiments.latency import PLANNING_COLUMNS, Latency, planning_rows
from moe_policy.experiments.overview import OVERVIEW_COLUMNS, OverviewTable
from moe_policy.experiments.records import read
from moe_policy.experiments.speed.guesses import SOLVER_COLUMNS
from moe_policy.experiments.splits import SPLIT_COLUMNS
from moe_policy.experiments.summary import summary_columns
from moe_policy.experiments.tables import Column, markdown_table

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "results/README.md")
BLOCK = re.compile(r"(<!-- table: (\S+)(?: (\w+))? -->\n).*?(<!-- end -->)", re.DOTALL)


def columns_of(name: str, record: dict[str, Any]) -> tuple[Column, ...]:
    if name == "table_summary":
        return summary_columns(record)
    if name.startswith("compare_splits"):
        return SPLIT_COLUMNS
    return TRAINING_COLUMNS


def table_of(name: str, part: str | None) -> str:
    path = ROOT / "results" / f"{name}.json"
    if name.startswith("benchmark_planning"):
        latency = read(path, Latency)
        if part == "planning":
            return markdown_table(planning_rows(latency), PLANNING_COLUMNS)
        return markdown_table(latency.solver, SOLVER_COLUMNS)
    if name == "table_overview":
        return markdown_table(read(path, OverviewTable).rows, OVERVIEW_COLUMNS)
    if name.startswith("budgets"):
        return markdown_table(read(path, Budgets).rows, BUDGET_COLUMNS)
    if name.startswith("sensitivity"):
        return markdown_table(read(path, Sensitivity).rows, COLUMNS)
    if fnmatch(name, "compare_[!st]*"):
        return markdown_table(read(path, Comparison).rows, COLUMNS)
    record = json.loads(path.read_text())
    return markdown_table(record[part or "rows"], columns_of(name, record))


def render(text: str) -> str:
    def table(block: re.Match[str]) -> str:
        return f"{block[1]}\n{table_of(block[2], block[3])}\n{block[4]}"

    return BLOCK.sub(table, text)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if a page differs")
    arguments = parser.parse_args()
    differ = False
    for path in (ROOT / page for page in PAGES):
        old = path.read_text()
        new = render(old)
        differ |= old != new
        if not arguments.check:
            path.write_text(new)
    return int(arguments.check and differ)


if __name__ == "__main__":
    sys.exit(main())
