"""The public names: what the signature of one mentions is public, too."""

from __future__ import annotations

import ast
import importlib
import importlib.resources
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache

import pytest

import moe_policy
import ocp_envs

PACKAGES = (ocp_envs, moe_policy)
PUBLIC = {id(getattr(package, name)) for package in PACKAGES for name in package.__all__}
#: Needs Stable-Baselines3, which may be absent.
OPTIONAL = {"SB3VecEnv"}
SPECIAL = ("__call__", "__getitem__", "__init__")


def is_ours(value: object) -> bool:
    return str(getattr(value, "__module__", "")).partition(".")[0] in ("ocp_envs", "moe_policy")


def functions(value: object) -> Iterator[object]:
    """``value``, or where it is a class of ours its public methods and those of its bases."""
    if not inspect.isclass(value):
        yield value
        return
    for base in filter(is_ours, value.__mro__):
        yield base
        for name, member in vars(base).items():
            if not name.startswith("_") or name in SPECIAL:
                member = getattr(member, "__func__", getattr(member, "fget", getattr(member, "func", member)))
                if inspect.isfunction(member):
                    yield member


def annotations(value: object) -> Iterator[tuple[str, str]]:
    """Modules and names in the annotations of ``value``."""
    for part in functions(value):
        own = vars(part) if inspect.isclass(part) else {"__annotations__": part.__annotations__}
        for name, annotation in own.get("__annotations__", {}).items():
            if not name.startswith("_"):
                text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
                yield from ((part.__module__, word) for word in set(re.findall(r"[A-Za-z_]\w*", text)))


@cache
def resolve(module: str, word: str) -> object:
    """What ``word`` is in ``module``, names imported for annotations alone included; ``None`` for none."""
    there = sys.modules[module]
    if word in vars(there):
        return vars(there)[word]
    for node in ast.walk(ast.parse(inspect.getsource(there))):
        if isinstance(node, ast.ImportFrom) and word in {alias.asname or alias.name for alias in node.names}:
            return getattr(importlib.import_module(str(node.module)), word, None)
    return None


@pytest.mark.parametrize(
    "value",
    [getattr(package, name) for package in PACKAGES for name in package.__all__],
    ids=[f"{package.__name__}.{name}" for package in PACKAGES for name in package.__all__],
)
def test_every_class_in_a_public_signature_is_public(value):
    mentioned = [resolve(*pair) for pair in annotations(value)] if is_ours(value) else []
    hidden = {cls.__name__ for cls in mentioned if inspect.isclass(cls) and is_ours(cls) and id(cls) not in PUBLIC}
    assert not hidden - OPTIONAL


def test_signatures_are_read():
    words = {word for _, word in annotations(ocp_envs.OptimalControlProblem)}
    assert {"Distribution", "Picture", "BatchFunctions"} <= words
    assert ("ocp_envs.data.generation", "GenerationSettings") in set(annotations(ocp_envs.generate))


def test_stepping_an_environment_loads_no_solver_and_no_database():
    code = """
import sys, gymnasium, ocp_envs
gymnasium.make("QuadcopterObstacle-v0").reset(seed=0)
assert not {"ocp_envs.solvers.solver", "ocp_envs.data.database", "zarr"} & set(sys.modules)
assert ocp_envs.load_reference.__module__ == "ocp_envs.sets.reference"
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_both_packages_are_typed():
    for package in PACKAGES:
        assert importlib.resources.files(package).joinpath("py.typed").is_file()


def test_no_public_name_looks_like_a_test():
    assert not [name for package in PACKAGES for name in package.__all__ if name.lower().startswith("test")]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_names_that_are_imported_later_stand_for_what_type_checkers_see(package):
    """The stub of a package is the list of its public names; what it lists is there, and in ``dir()``."""
    stub = ast.parse(importlib.resources.files(package).joinpath("__init__.pyi").read_text())
    listed = {
        alias.asname: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert sorted(listed) == package.__all__
    assert set(listed) <= set(dir(package))
    for name, module in listed.items():
        assert getattr(package, name) is getattr(importlib.import_module(module), name)


def test_names_that_are_not_public_are_no_attributes():
    with pytest.raises(AttributeError, match="module 'ocp_envs' has no attribute 'nothing'"):
        _ = ocp_envs.nothing
