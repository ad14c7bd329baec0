"""What docstrings and signatures refer to: public names by whatever module names them, and names without a page."""

from __future__ import annotations

import builtins
import sys
import typing
from collections.abc import Iterator
from functools import cache
from types import ModuleType

from docutils.nodes import TextElement
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import moe_policy
import ocp_envs

PACKAGES = (ocp_envs, moe_policy)


def separate(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Keep Napoleon from reading the text before a colon as the type of an attribute: it looks in the first line.

    That line becomes an empty comment.
    """
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: TextElement) -> TextElement | None:
    """The link to a public name that is referred to by its module; plain text for a name that exists without a page.

    ``None``, which Sphinx reports, for a name that does not exist.
    """
    if node.get("refdomain") != "py":
        return None
    target, python = str(node["reftarget"]), env.domains.python_domain
    owner = f"{node.get('py:module')}.{node.get('py:class')}.{target}"
    known = [name for name in (target, owner) if _exists(name)]
    if not known:
        return None
    public = _public(known[0])
    if public in python.objects:
        return python.resolve_xref(env, node["refdoc"], app.builder, "obj", public, node, content)
    return content


def _modules() -> Iterator[ModuleType]:
    """The modules in whose name space a name may stand: those of the packages, then Python's own."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in ("ocp_envs", "moe_policy"):
            yield module
    yield from (builtins, typing)


def _in(value: object, names: list[str]) -> bool:
    """Whether ``value`` has the attribute or the field ``names[0]``, that the next of ``names``, and so on."""
    if not names:
        return True
    if hasattr(value, names[0]):
        return _in(getattr(value, names[0]), names[1:])
    return len(names) == 1 and names[0] in getattr(value, "__annotations__", {})


@cache
def _exists(name: str) -> bool:
    """Whether a module, a variable, an attribute or a field called ``name`` exists."""
    module, _, rest = name.rpartition(".")
    while module:
        if module in sys.modules:
            return _in(sys.modules[module], rest.split("."))
        module, _, last = module.rpartition(".")
        rest = f"{last}.{rest}"
    return name in sys.modules or any(_in(each, name.split(".")) for each in _modules())


@cache
def _public(name: str) -> str:
    """The public name of what is called ``name``, or of its owner with the rest of ``name``."""
    owner, _, last = name.rpartition(".")
    for package in PACKAGES:
        if last in package.__all__:
            return f"{package.__name__}.{last}"
    return f"{_public(owner)}.{last}" if owner else name
