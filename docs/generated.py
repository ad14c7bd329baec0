"""The pages that are derived: of the environments, of the public names, and of the results; git ignores them."""

from __future__ import annotations

import ast
import importlib
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import ocp_envs
from ocp_envs.problems import BENCHMARK

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ocp_envs", "moe_policy")
#: A link or an image in Markdown: what stands before the path, and the path of a file in the repository.
LINK = re.compile(r"(\]\()(?!\w+:|#)([^)\s]+)")
#: Titles of the pages of public names by wing, where they are not the name of the wing.
TITLES = {
    "ocp_envs": "Declaration of problems",
    "ocp_envs.render": "Pictures",
    "ocp_envs.solvers": "Solver",
    "ocp_envs.data": "Databases",
    "ocp_envs.sets": "Sets of instances",
    "ocp_envs.support": "Functions on arrays",
    "moe_policy": "Protocols and shipped models",
    "moe_policy.control": "Tracking",
    "moe_policy.rollouts": "Rollouts and metrics",
    "moe_policy.checking": "Checked plans",
    "moe_policy.rl": "Reinforcement learning",
    "moe_policy.score": "Scores",
}


def write(docs: Path) -> None:
    """Write all of them into the folder ``docs``; a file that would not change is left alone."""
    for problem in BENCHMARK:
        _put(docs / "environments" / f"{problem.id}.md", environment(problem.id))
    for wing, names in public_names().items():
        _put(docs / "api" / f"{wing}.rst", reference(wing, names))
    _put(docs / "results.md", results())


def _put(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def environment(name: str) -> str:
    """The page of the environment called ``name``, with its animation."""
    title, _, rest = ocp_envs.describe(name).partition("\n")
    animation = f"![An optimal episode](../animations/{name}.webp)"
    shown = animation if (ROOT / "docs" / "animations" / f"{name}.webp").exists() else ""
    return f"{title}\n\n{shown}\n{rest}"


def public_names() -> dict[str, list[str]]:
    """The public names of the two packages by the wing that defines them, as the stubs list them."""
    found: dict[str, list[str]] = defaultdict(list)
    for package in PACKAGES:
        stub = ast.parse((ROOT / package / "__init__.pyi").read_text(encoding="utf-8"))
        for node in stub.body:
            if isinstance(node, ast.ImportFrom):
                wing = ".".join(str(node.module).split(".")[:2])
                folder = wing if (ROOT / wing.replace(".", "/")).is_dir() else package
                found[folder] += [f"{package}.{alias.name}" for alias in node.names]
    return found


def reference(wing: str, names: list[str]) -> str:
    """The page of the public ``names`` that a ``wing`` defines."""
    doc = "" if wing in PACKAGES else importlib.import_module(wing).__doc__ or ""
    title = TITLES.get(wing, wing.rpartition(".")[2].capitalize())
    return "\n".join([*_heading(title, "="), doc, "", *(line for name in names for line in _entry(name))])


def _heading(text: str, line: str) -> list[str]:
    return [text, line * len(text), ""]


def _entry(name: str) -> Iterator[str]:
    package, _, attribute = name.rpartition(".")
    value = getattr(importlib.import_module(package), attribute)
    yield from _heading(attribute, "-")
    if isinstance(value, type):
        kind = "autoexception" if issubclass(value, Exception) else "autoclass"
    else:
        kind = "autofunction" if callable(value) and hasattr(value, "__name__") else "autodata"
    yield f".. {kind}:: {name}"
    yield ""


def results() -> str:
    """The page of results with its links and pictures as seen from the folder of the documentation."""
    text = (ROOT / "results" / "README.md").read_text(encoding="utf-8")
    return LINK.sub(lambda found: found[1] + _moved(found[2]), text)


def _moved(target: str) -> str:
    if target.startswith("../docs/"):
        return target.removeprefix("../docs/")
    if target.startswith("../README.md"):
        return "index.md"
    return target if target.startswith("../") else f"../results/{target}"
