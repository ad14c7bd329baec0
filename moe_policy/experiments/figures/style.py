"""One style for all figures: colours, names on axes, and how they are saved."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.files import replacing
from ocp_envs.system import Coordinate

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:  # matplotlib is optional, and slow to import
    Axes = Figure = object

#: Axes in rows and columns, as Matplotlib's ``subplots`` returns them.
Panels = NDArray[np.object_]
#: matplotlib's settings of all figures.
STYLE: dict[str, object] = {
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
#: Colours of Okabe and Ito, which colour-blind readers distinguish, too.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
_CLUSTER_COLORS = (*COLORS[:6], "#882255", "#44aa99", "#999933", "#aa4499", "#117733", "#332288")
#: The colour of each method in all figures, by the beginning of its name.
METHODS = {
    "optimal": COLORS[0],
    "nearest": COLORS[1],
    "snn": COLORS[2],
    "moe-custom": COLORS[3],
    "mixture": COLORS[3],
    "moe-kmeans": COLORS[4],
    "sac": COLORS[5],
    "ppo": COLORS[6],
    "stabiliser": COLORS[7],
    "moe-auto": "#882255",
    "checked": "#44aa99",
    "tqc": "#999933",
    "bc": "#aa4499",
    "ppo-bc": "#7f4f21",
}
_LINES = ("-", "--", ":", "-.")
#: Formats of figures, and the metadata that is left out, so that equal figures are equal files.
_METADATA: dict[str, dict[str, object]] = {".png": {"Software": None}, ".pdf": {"CreationDate": None}}
INK = "#000000"
_GREEK = {"theta": "θ", "omega": "ω", "phi": "φ", "psi": "ψ", "pi": "π"}


def cluster_color(cluster: int) -> str:
    """The colour of a cluster; they repeat after twelve."""
    return _CLUSTER_COLORS[cluster % len(_CLUSTER_COLORS)]


def looks(names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Colour and line of each method; variants, such as ``"snn, half turn"``, share the colour of their policy.

    A method has the same colour in all figures (:data:`METHODS`); what is not listed there gets a colour that is left.
    """
    left = (color for color in _CLUSTER_COLORS if color not in METHODS.values())
    colors: dict[str, str] = {}  # of each policy
    found: dict[str, dict[str, str]] = {}
    for name in dict.fromkeys(names):
        policy = name.split(", ")[0]
        color = colors.setdefault(policy, _method_color(policy) or next(left, COLORS[-1]))
        nth = sum(look["color"] == color for look in found.values())
        found[name] = {"color": color, "linestyle": _LINES[nth % len(_LINES)]}
    return found


def _method_color(policy: str) -> str | None:
    """The colour of the method whose name is the longest beginning of ``policy``; ``None`` for an unknown one."""
    known = [name for name in METHODS if policy.startswith(name)]
    return METHODS[max(known, key=len)] if known else None


def _in_a_palette(png: BytesIO) -> bytes:
    """``png`` with a palette of 256 colours, at a third of its size."""
    from PIL import Image

    small, image = BytesIO(), Image.open(png)
    palette = image.convert("RGB").quantize(256, Image.Quantize.MEDIANCUT, kmeans=1, dither=Image.Dither.NONE)
    palette.save(small, format="PNG", optimize=True, dpi=image.info["dpi"])
    return small.getvalue()


def save_figure(path: str | Path, size: tuple[float, float], draw: Callable[[Figure], None]) -> Path:
    """Fill an empty figure of ``size`` (inches) in the common style with ``draw``, save it, and return the file.

    A path without ``.png`` or ``.pdf`` gives both, and returns the first. Each file is replaced in one step. Raises an
    ``ImportError`` without matplotlib, which comes with the extra ``plots``.
    """
    try:
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError('figures need matplotlib; install it with: pip install "ocp-moe[plots]"') from error
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


def coordinate_text(name: str) -> str:
    """``theta_f = -2 pi, backwards`` → ``θ_f = −2π, backwards``, with the index as a subscript."""
    text = re.sub("[a-z]+", lambda word: _GREEK.get(word[0], word[0]), name)
    text = re.sub(r"\b(\w)_(\w)\b", r"$\1_\2$", text)
    text = re.sub(r"(\d) π", r"\1π", text).replace(" 0π", " 0")
    return re.sub(r"-(?=[\dπ])", "−", text)


def label_state(axes: Axes, coordinate: Coordinate) -> None:
    """Name the state coordinate on the y axis of ``axes``; the ticks of angles are the multiples of π in view."""
    axes.set_ylabel(coordinate_text(coordinate.name) + ("" if coordinate.unit == "1" else f", {coordinate.unit}"))
    if coordinate.period is not None and np.isclose(coordinate.period, 2 * np.pi):
        low, high = axes.get_ylim()
        multiples = np.arange(np.ceil(low / np.pi), np.floor(high / np.pi) + 1)
        short = {-1: "−π", 0: "0", 1: "π"}
        names = [short.get(int(count), coordinate_text(f"{count:.0f} pi")) for count in multiples]
        axes.set_yticks(multiples * np.pi, names)
