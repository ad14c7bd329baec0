"""Learning the solutions of parametric optimal control problems, and tracking the plans that were learnt.

Names are imported on first use: rolling out a policy does not load PyTorch, and Stable-Baselines3 may be absent. The
public names and their modules are listed in ``__init__.pyi``, which type checkers read.
"""

from __future__ import annotations

import ast
import importlib
from pathlib import Path


def _modules() -> dict[str, str]:
    """The module of every public name."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = (node for node in stub.body if isinstance(node, ast.ImportFrom))
    return {alias.name: str(node.module) for node in imports for alias in node.names}


_MODULE_OF = _modules()

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
