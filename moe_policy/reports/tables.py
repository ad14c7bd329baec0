"""Tables as text: columns that take attributes of rows, in Markdown and for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from moe_policy.reports.records import present
from moe_policy.rollouts.intervals import Proportion

Row = TypeVar("Row")
Whole = TypeVar("Whole")
#: The text of a cell without a value.
DASH = "–"


@dataclass(frozen=True)
class Column(Generic[Row]):
    """A column of a table.

    Args:
        title: heading.
        of: row → value; ``None``, NaN and :data:`~moe_policy.reports.records.ABSENT` become a dash.
        form: how a value is written: a format specification such as ``".3f"``, or a function to text.
    """

    title: str
    of: Callable[[Row], object]
    form: str | Callable[[Any], str] = ""

    def cell(self, row: Row) -> str:
        """The text for ``row``."""
        value = present(self.of(row))
        if value is None or (isinstance(value, (float, np.floating)) and np.isnan(value)):
            return DASH
        return self.form(value) if callable(self.form) else format(value, self.form)

    def of_part(self, part: Callable[[Whole], Row]) -> Column[Whole]:
        """The same column for rows that contain such a row as their ``part``."""
        return Column(self.title, lambda whole: self.of(part(whole)), self.form)


def proportion(value: Proportion) -> str:
    """``value`` as text, for instance ``998 (99.3–99.9 %)``: the count and its interval."""
    low, high = value.interval
    return f"{value.count} ({100 * low:.1f}–{100 * high:.1f} %)"


class Spreading(Protocol):
    """A median with the range around it, as over training seeds."""

    @property
    def median(self) -> float: ...
    @property
    def minimum(self) -> float: ...
    @property
    def maximum(self) -> float: ...


def with_range(form: str) -> Callable[[Spreading], str]:
    """What writes a spread, each value in ``form``: for instance ``471 (400–478)``, the median and its range."""
    return lambda found: f"{found.median:{form}} ({found.minimum:{form}}–{found.maximum:{form}})"


def duration(seconds: float) -> str:
    """``seconds`` with the prefix that fits, three digits: ``12.3 µs``, ``4.56 ms``, ``7.89 s``, ``12.3 min``."""
    if seconds >= 120:
        return f"{seconds / 60:.3g} min"
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * factor >= 1 or unit == "µs":
            return f"{seconds * factor:.3g} {unit}"
    raise AssertionError


def _cells(rows: Sequence[Row], columns: Sequence[Column[Row]]) -> tuple[list[list[str]], list[bool]]:
    """Texts with the headings first, and which columns hold numbers and are aligned to the right.

    A column without any value is left out.
    """
    columns = [c for c in columns if not rows or any(c.cell(row) != DASH for row in rows)]
    cells = [[c.title for c in columns]] + [[c.cell(row) for c in columns] for row in rows]
    right = [all(not isinstance(c.of(row), str) for row in rows) for c in columns]
    return cells, right


def markdown_table(rows: Sequence[Row], columns: Sequence[Column[Row]]) -> str:
    """A Markdown table of ``rows`` with the ``columns``, numbers aligned to the right; ends with a newline."""
    cells, right = _cells(rows, columns)
    head, *body = [[text.replace("|", "\\|") for text in line] for line in cells]
    lines = [head, ["---:" if r else "---" for r in right], *body]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def text_table(rows: Sequence[Row], columns: Sequence[Column[Row]]) -> str:
    """The table of ``rows`` with the ``columns`` for a terminal, aligned with spaces."""
    cells, right = _cells(rows, columns)
    widths = [max(len(line[i]) for line in cells) for i in range(len(cells[0]))]
    rule = ["-" * width for width in widths]
    lines = []
    for line in [cells[0], rule, *cells[1:]]:
        padded = [text.rjust(w) if r else text.ljust(w) for text, w, r in zip(line, widths, right)]
        lines.append("  ".join(padded).rstrip() + "\n")
    return "".join(lines)
