"""Colours of the pictures, and Matplotlib, imported when the first picture is drawn."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any, TypeAlias

#: Objects of Matplotlib, which is not imported for their types, and keyword arguments of its functions.
Artist: TypeAlias = Any
Axes: TypeAlias = Artist
Figure: TypeAlias = Artist
Style = dict[str, object]

PATH, PLAN, GOAL, INK, GREY = "#3b6ea5", "#d1781f", "#3a8f4d", "#333333", "#8a8f98"
#: Line style of a plan.
DASHES: Style = {"lw": 1.6, "ls": (0, (4, 2.5))}


def matplotlib(module: str) -> ModuleType:
    """``matplotlib.<module>``; raises an ``ImportError`` if Matplotlib (extra ``plots``) is not installed."""
    try:
        return importlib.import_module(f"matplotlib.{module}")
    except ImportError as error:
        raise ImportError("drawing needs Matplotlib: pip install 'ocp-moe[plots]'") from error
