"""One HTML file from a template, styles and JavaScript modules.

Browsers load no modules from files, so all modules become one script: each is a function of its own, in the order of
its imports, that returns what it exports.
"""

from __future__ import annotations

import graphlib
import re
from collections.abc import Sequence
from pathlib import Path

#: The page's own files: the template, styles, JavaScript modules and C.
SOURCES = Path(__file__).parent / "source"
_IMPORT = re.compile(r'^import (\{[^}]*\}) from "([^"]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?:(?:async )?function|class|const|let) (\w+)", re.MULTILINE)
_EXPORT_LIST = re.compile(r"^export \{([^}]*)\};\n", re.MULTILINE)


def page(sources: Path, problems: Sequence[str]) -> str:
    """The HTML of the folder ``sources`` for ``problems``, with its styles and scripts inside."""
    styles = "\n".join(path.read_text(encoding="utf-8") for path in sorted((sources / "css").glob("*.css")))
    template = (sources / "index.html").read_text(encoding="utf-8")
    parts = {"problems": " ".join(problems), "styles": styles, "script": script(sources / "js", "app.js")}
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def script(folder: Path, entry: str) -> str:
    """The modules that the module ``entry`` of a ``folder`` needs, as one script.

    Raises:
        graphlib.CycleError: modules that import each other.
    """
    texts: dict[Path, str] = {}
    needs: dict[Path, list[Path]] = {}
    waiting = [(folder / entry).resolve()]
    while waiting:
        path = waiting.pop()
        if path not in texts:
            texts[path] = path.read_text(encoding="utf-8")
            needs[path] = [(path.parent / found[2]).resolve() for found in _IMPORT.finditer(texts[path])]
            waiting += needs[path]
    order = list(graphlib.TopologicalSorter(needs).static_order())
    names = {path: f"module_{i}" for i, path in enumerate(order)}
    return '"use strict";\n' + "\n".join(_as_function(path, texts[path], names) for path in order)


def _as_function(path: Path, text: str, names: dict[Path, str]) -> str:
    """The module ``text`` at ``path`` as a function that is called once; ``names`` are those of all modules."""
    exports = _EXPORT.findall(text)
    for found in _EXPORT_LIST.finditer(text):
        exports += [name.strip() for name in found[1].split(",")]

    def imported(found: re.Match[str]) -> str:
        return f"const {found[1].replace(' as ', ': ')} = {names[(path.parent / found[2]).resolve()]};\n"

    body = _IMPORT.sub(imported, _EXPORT_LIST.sub("", text))
    body = re.sub(r"^export ", "", body, flags=re.MULTILINE)
    return f"const {names[path]} = (() => {{\n{body}return {{ {', '.join(exports)} }};\n}})();\n"
