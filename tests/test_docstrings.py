"""The docstring of every public function and class of the library names all of its arguments."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: The library: what is in the wheel. The experiments are read with the record or the figure that they make.
LIBRARY = [path for package in ("ocp_envs", "moe_policy") for path in (ROOT / package).rglob("*.py")]
MODULES = sorted(path.relative_to(ROOT).as_posix() for path in LIBRARY if "experiments" not in path.parts)
Function = ast.FunctionDef | ast.AsyncFunctionDef


def _arguments(function: Function) -> list[str]:
    spec = function.args
    named = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs]
    return [argument.arg for argument in named if argument.arg not in ("self", "cls") and argument.arg[0] != "_"]


def _missing(names: list[str], docstring: str | None) -> list[str]:
    """The names that do not occur in ``docstring`` as words of their own."""
    return [name for name in names if not re.search(rf"\b{re.escape(name)}\b", docstring or "")]


def _fields(node: ast.ClassDef) -> list[str]:
    """Arguments of the constructor that a dataclass derives from its fields."""
    if not any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list):
        return []
    annotated = [item for item in node.body if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)]
    return [
        item.target.id
        for item in annotated
        if "ClassVar" not in ast.unparse(item.annotation) and "init=False" not in ast.unparse(item)
        if not item.target.id.startswith("_")
    ]


def _own(node: ast.ClassDef) -> Iterator[tuple[str, list[str]]]:
    """Name and missing arguments of a class and of its public methods.

    A method without a docstring implements a protocol (``predict``, ``step``, ``submit`` …), which documents it.
    """
    docstring = ast.get_docstring(node)
    methods = [item for item in node.body if isinstance(item, Function)]
    for method in methods:
        if method.name == "__init__":
            yield node.name, _missing(_arguments(method), f"{docstring}\n{ast.get_docstring(method)}")
        elif (text := ast.get_docstring(method)) and (method.name == "__call__" or method.name[0] != "_"):
            yield f"{node.name}.{method.name}", _missing(_arguments(method), text)
    yield node.name, _missing(_fields(node), docstring)


def unnamed(source: str) -> dict[str, list[str]]:
    """Arguments that the docstring of a public function or class of ``source`` does not name, by its name."""
    found: dict[str, list[str]] = {}
    for node in ast.parse(source).body:
        if isinstance(node, Function) and not node.name.startswith("_"):
            found[node.name] = _missing(_arguments(node), ast.get_docstring(node))
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for name, missing in _own(node):
                found[name] = found.get(name, []) + missing
    return {name: missing for name, missing in found.items() if missing}


@pytest.mark.parametrize("module", MODULES)
def test_docstrings_name_every_argument(module):
    assert unnamed((ROOT / module).read_text(encoding="utf-8")) == {}


def test_an_argument_that_is_not_named_is_found():
    source = '''
def f(x, size): """Of x."""
def _g(y): ...
@dataclass(frozen=True)
class C:
    """A value: a."""
    a: int
    b: int
    c: int = field(init=False)
    def m(self, z): """Nothing."""
    def undocumented(self, w): ...
'''
    assert unnamed(source) == {"f": ["size"], "C": ["b"], "C.m": ["z"]}
