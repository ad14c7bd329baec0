"""The public names of a package, listed once: in its ``__init__.pyi``, which type checkers read, too.

Names are imported on first use, so that a package costs no more than what is used of it.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path


def public_names(package: str, file: str) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """``__all__``, ``__getattr__`` and ``__dir__`` of ``package``, whose ``__init__.py`` is ``file``.

    Raises:
        AttributeError: from ``__getattr__``, for a name that is not public.
    """
    stub = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = (node for node in stub.body if isinstance(node, ast.ImportFrom))
    module_of = {alias.name: str(node.module) for node in imports for alias in node.names}
    own = vars(sys.modules[package])

    def getattribute(name: str) -> object:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        own[name] = getattr(importlib.import_module(module_of[name]), name)
        return own[name]

    return sorted(module_of), getattribute, lambda: sorted({*own, *module_of})
