"""Names of coordinates and clusters in figures, with Greek letters, and multiples of π on axes."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from moe_policy.learning.clustering import Labels
from ocp_envs.data.samples import Samples
from ocp_envs.system import Coordinate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#000000"
_GREEK = {"theta": "θ", "omega": "ω", "phi": "φ", "psi": "ψ", "pi": "π"}


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


def check_labels(samples: Samples, labels: Labels, shown: int) -> None:
    """Raise a ``ValueError`` unless there is one label for each sample and at least one is shown."""
    if len(labels) != len(samples.parameters):
        raise ValueError(f"expected a label for each of {len(samples.parameters)} samples, got {len(labels)}")
    if shown < 1:
        raise ValueError(f"shown must be at least 1, got {shown}")
