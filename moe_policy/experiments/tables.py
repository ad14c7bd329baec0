"""Tables as text and figures as PNG, made from the figures of :mod:`moe_policy.rollouts.metrics`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.rollouts.intervals import Proportion
from ocp_envs.support.arrays import Array
from ocp_envs.support.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: What stands in a cell without a value.
ABSENT = "–"

#: One look for all figures; the colours are Okabe and Ito's, told apart by colour-blind readers too.
STYLE: dict[str, Any] = {
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
}
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
_CLUSTER_COLORS = (*COLORS[:6], "#882255", "#44aa99", "#999933", "#aa4499", "#117733", "#332288")
_LINES = ("-", "--", ":", "-.")


def cluster_color(cluster: int) -> str:
    """The colour of a cluster; they repeat after twelve."""
    return _CLUSTER_COLORS[cluster % len(_CLUSTER_COLORS)]


# -- tables ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Args:
        key: key of the value in a row.
        title: heading.
        form: how a value is written: a format specification such as ``".3f"``, or a function to text. A row without
            the key, or with ``None`` or NaN, gets a dash.
    """

    key: str
    title: str
    form: str | Callable[[Any], str] = ""

    def cell(self, row: Mapping[str, Any]) -> str:
        """The text for ``row``."""
        value = row.get(self.key)
        if value is None or (isinstance(value, (float, np.floating)) and np.isnan(value)):
            return ABSENT
        return self.form(value) if callable(self.form) else format(value, self.form)


def share(value: Proportion) -> str:
    """For instance ``998 (99.3–99.9 %)``: the count and its interval."""
    low, high = value.interval
    return f"{value.count} ({100 * low:.1f}–{100 * high:.1f} %)"


def duration(seconds: float) -> str:
    """Seconds with the prefix that fits, three digits: ``12.3 µs``, ``4.56 ms``, ``7.89 s``, ``12.3 min``."""
    if seconds >= 120:
        return f"{seconds / 60:.3g} min"
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * factor >= 1 or unit == "µs":
            return f"{seconds * factor:.3g} {unit}"
    raise AssertionError


def _cells(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> tuple[list[list[str]], list[bool]]:
    """Texts with the headings first, and which columns hold numbers and are set to the right.

    A column without any value is left out.
    """
    columns = [c for c in columns if not rows or any(c.cell(row) != ABSENT for row in rows)]
    cells = [[c.title for c in columns]] + [[c.cell(row) for c in columns] for row in rows]
    right = [all(not isinstance(row.get(c.key), str) for row in rows) for c in columns]
    return cells, right


def markdown_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> str:
    """A Markdown table, numbers to the right; ends with a newline."""
    cells, right = _cells(rows, columns)
    head, *body = [[text.replace("|", "\\|") for text in line] for line in cells]
    lines = [head, ["---:" if r else "---" for r in right], *body]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def text_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> str:
    """The same for a terminal, aligned with spaces."""
    cells, right = _cells(rows, columns)
    widths = [max(len(line[i]) for line in cells) for i in range(len(cells[0]))]
    rule = ["-" * width for width in widths]
    lines = []
    for line in [cells[0], rule, *cells[1:]]:
        padded = [text.rjust(w) if r else text.ljust(w) for text, w, r in zip(line, widths, right)]
        lines.append("  ".join(padded).rstrip() + "\n")
    return "".join(lines)


# -- figures -----------------------------------------------------------------------------------------------------------


def looks(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Colour and line of everybody in a figure, for matplotlib: variants of one policy share its colour.

    Args:
        names: as in the tables, where a variant has the name of its policy before a comma, as in ``"snn, half turn"``.
    """
    variants: dict[str, int] = {}  # of each policy, so far
    found: dict[str, dict[str, Any]] = {}
    for name in dict.fromkeys(names):
        policy = name.split(", ")[0]
        nth = variants[policy] = variants.get(policy, -1) + 1
        color = COLORS[list(variants).index(policy) % len(COLORS)]
        found[name] = {"color": color, "linestyle": _LINES[nth % len(_LINES)]}
    return found


#: Formats of figures, and what is left out of their files so that equal figures are equal files.
_METADATA: dict[str, dict[str, Any]] = {".png": {"Software": None}, ".pdf": {"CreationDate": None}}


def _in_a_palette(png: BytesIO) -> bytes:
    """``png`` in the 256 colours that serve it best, at a third of its size; lines on white have few."""
    from PIL import Image

    small, image = BytesIO(), Image.open(png)
    palette = image.convert("RGB").quantize(256, Image.Quantize.MEDIANCUT, kmeans=1, dither=Image.Dither.NONE)
    palette.save(small, format="PNG", optimize=True, dpi=image.info["dpi"])
    return small.getvalue()


def save_figure(path: str | os.PathLike[str], size: tuple[float, float], draw: Callable[[Figure], None]) -> Path:
    """Draw a figure in the common style and save it, each file in one step.

    Args:
        path: file to write, ``.png`` or ``.pdf``; without such a suffix both are written. Missing folders are made.
        size: width and height in inches.
        draw: fills an empty figure.

    Returns:
        the file, the PNG of both.

    Raises:
        ImportError: matplotlib is missing; it comes with the extra ``plots``.
    """
    try:
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError('figures need matplotlib: pip install "ocp-moe[plots]"') from error
    target = Path(path)
    files = [target] if target.suffix in _METADATA else [target.with_name(target.name + kind) for kind in _METADATA]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        for file in files:
            drawn = BytesIO()
            figure.savefig(drawn, format=file.suffix[1:], metadata=_METADATA[file.suffix])
            with replacing(file) as content:
                content.write(_in_a_palette(drawn) if file.suffix == ".png" else drawn.getvalue())
    return files[0]


@dataclass(frozen=True, eq=False)
class Outcome:
    """One policy in the comparison figure.

    Args:
        name: label.
        success: at the judging time.
        success_at_plan_end: before any hold; ``None`` without a plan.
        errors: ‖x − goal‖ at the plan's end, (B,); ``None`` without a plan.
    """

    name: str
    success: Proportion
    success_at_plan_end: Proportion | None = None
    errors: Array | None = None


def draw_success(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    """Fraction of successes of each policy with its 95 % interval; open marks: at the plan's end, without the hold."""
    styles = looks(outcome.name for outcome in outcomes)
    for i, outcome in enumerate(outcomes):
        color = styles[outcome.name]["color"]
        marks = ((outcome.success, -0.12, color), (outcome.success_at_plan_end, 0.12, "white"))
        for value, shift, face in marks:
            if value is None:
                continue
            low, high = value.interval
            axes.plot([100 * low, 100 * high], [i + shift] * 2, color=color)
            axes.plot(100 * value.fraction, i + shift, "o", color=color, markerfacecolor=face, markersize=5)
    axes.set_yticks(range(len(outcomes)), [outcome.name for outcome in outcomes])
    axes.set_ylim(len(outcomes) - 0.5, -0.5)
    axes.set_xlabel("success, %, with 95 % interval")
    axes.set_title("filled: after the hold, open: at the plan's end")


def draw_errors(axes: Axes, outcomes: Sequence[Outcome], radius: float) -> None:
    """Distribution of the error at the plan's end; the dashed line is the goal's ``radius``."""
    styles = looks(outcome.name for outcome in outcomes)
    for outcome in outcomes:
        if outcome.errors is None:
            continue
        errors = np.sort(outcome.errors[np.isfinite(outcome.errors)])
        if len(errors):
            percent = 100 * np.arange(1, len(errors) + 1) / len(errors)
            axes.step(np.maximum(errors, 1e-9), percent, where="post", label=outcome.name, **styles[outcome.name])
    axes.axvline(radius, color="black", linestyle="--", linewidth=0.8, label="goal ball")
    axes.set_xscale("log")
    axes.set_ylim(0, 101)
    axes.set_xlabel("state error at the plan's end")
    axes.set_ylabel("episodes below, %")
    axes.set_title("before any hold")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def comparison_figure(path: str | os.PathLike[str], outcomes: Sequence[Outcome], radius: float) -> Path:
    """Success of all policies beside the distribution of their errors at the plan's end, saved as PNG."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        draw_success(left, outcomes)
        draw_errors(right, outcomes, radius)

    return save_figure(path, (10.0, 1.6 + 0.35 * len(outcomes)), draw)
