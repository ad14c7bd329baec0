"""The direction of the imports: the plan of the house, enforced."""

from __future__ import annotations

import ast
import graphlib
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import moe_policy
import ocp_envs

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ocp_envs", "moe_policy")
#: The wings, each allowed to import those above it, and what stands in none of them: the declaration of a problem at
#: the root of ``ocp_envs``, the protocols, model files and the store at that of ``moe_policy``, and the public names of
#: the two packages.
WINGS = {
    "ocp_envs.support": None,
    "declaration": (
        "expressions",
        "system",
        "trajectory",
        "symmetry",
        "picture",
        "goal",
        "tables",
        "distribution",
        "distributions",
        "parameters",
        "formulation",
        "functions",
        "horizon",
        "terminal",
        "fingerprint",
        "points",
        "holding",
        "trial",
        "declaration",
        "control_step",
        "problem",
        "feasibility",
    ),
    "ocp_envs.problems": None,
    "ocp_envs.render": None,
    "ocp_envs.envs": None,
    "ocp_envs.solvers": None,
    "ocp_envs.data": None,
    "ocp_envs.sets": None,
    "info": ("info",),
    "ocp_envs": ("",),
    "protocols": ("protocols", "model_files"),
    "moe_policy.planners": None,
    "moe_policy.learning": None,
    "moe_policy.control": None,
    "moe_policy.rollouts": None,
    "moe_policy.checking": None,
    "moe_policy.replanning": None,
    "moe_policy.rl": None,
    "moe_policy.reports": None,
    "store": ("store",),
    "moe_policy.score": None,
    "moe_policy": ("",),
    "moe_policy.experiments": None,
}
LEARNING = {"moe_policy", "torch", "sklearn", "safetensors", "stable_baselines3"}
#: Wings that must not reach each other by any way through other modules.
STRANGERS = (
    ("declaration", ("ocp_envs.envs", "ocp_envs.solvers", "ocp_envs.data", "ocp_envs.sets")),
    ("ocp_envs.problems", ("ocp_envs.envs", "ocp_envs.solvers", "ocp_envs.data", "ocp_envs.sets")),
    ("ocp_envs.envs", ("ocp_envs.solvers", "ocp_envs.data", "ocp_envs.sets")),
    ("ocp_envs.solvers", ("ocp_envs.envs",)),
    ("ocp_envs.data", ("ocp_envs.envs",)),
)


def _sources() -> dict[str, Path]:
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


SOURCES = _sources()


def _nodes(node: ast.AST, types: bool) -> Iterator[ast.AST]:
    """All nodes below ``node``; without ``types`` none of what is imported for annotations alone."""
    yield node
    for child in ast.iter_child_nodes(node):
        if types or not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from _nodes(child, types)


def _imported(path: Path, types: bool = True) -> set[str]:
    """Everything a file imports, anywhere in it; of our own modules their full names."""
    names = set()
    for node in _nodes(ast.parse(path.read_text(encoding="utf-8")), types):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            submodules = {f"{node.module}.{alias.name}" for alias in node.names} & set(SOURCES)
            others = len(submodules) < len(node.names)
            names |= submodules | ({str(node.module)} if others else set())
    return names


IMPORTS = {module: _imported(path) for module, path in SOURCES.items()}
GRAPH = {module: names & set(SOURCES) for module, names in IMPORTS.items()}


def _reachable(module: str) -> set[str]:
    found, waiting = set(), [module]
    while waiting:
        new = GRAPH[waiting.pop()] - found
        found |= new
        waiting += new
    return found


def _roots(module: str) -> set[str]:
    return {name.partition(".")[0] for name in IMPORTS[module]}


def _wing(module: str) -> str:
    """The wing a module stands in."""
    package, _, rest = module.partition(".")
    folder = f"{package}.{rest.partition('.')[0]}"
    if folder in WINGS:
        return folder
    if not rest:
        return package
    if package == "ocp_envs":
        return "info" if rest == "info" else "declaration"
    return "store" if rest == "store" else "protocols"


MODULES_OF = {wing: {module for module in SOURCES if _wing(module) == wing} for wing in WINGS}


def test_every_wing_and_every_module_that_is_named_exists():
    assert all(MODULES_OF.values()), [wing for wing, modules in MODULES_OF.items() if not modules]
    for wing, names in WINGS.items():
        if names is not None:
            package = "ocp_envs" if wing in ("declaration", "info", "ocp_envs") else "moe_policy"
            assert {f"{package}.{name}".rstrip(".") for name in names} == MODULES_OF[wing]


def test_modules_do_not_import_each_other_in_a_circle():
    graph = {module: _imported(path, types=False) & set(SOURCES) for module, path in SOURCES.items()}
    list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, naming the circle


def test_wings_import_only_wings_above_them():
    place = {wing: i for i, wing in enumerate(WINGS)}
    wrong = [
        f"{module} imports {name}"
        for module, names in GRAPH.items()
        for name in names
        if place[_wing(name)] > place[_wing(module)]
    ]
    assert not wrong


@pytest.mark.parametrize("module", sorted(SOURCES))
def test_environments_know_nothing_of_learning_and_nothing_imports_scripts(module):
    assert not _roots(module) & {"scripts", "tests"}
    if module.startswith("ocp_envs"):
        assert not _roots(module) & LEARNING


@pytest.mark.parametrize(("wing", "strangers"), STRANGERS)
def test_wings_that_must_not_know_each_other_do_not(wing, strangers):
    unknown = set().union(*(MODULES_OF[stranger] for stranger in strangers))
    for module in MODULES_OF[wing]:
        assert not _reachable(module) & unknown, module


def test_every_public_name_exists_without_the_optional_packages():
    code = """
import sys
for optional in ("stable_baselines3", "distributed"):
    sys.modules[optional] = None
import moe_policy
from moe_policy import *
assert callable(moe_policy.rollout) and callable(rollout)
assert set(moe_policy.__all__) <= set(dir(moe_policy))
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_no_public_name_is_hidden_by_a_wing():
    for package in (moe_policy, ocp_envs):
        assert not {f"{package.__name__}.{name}" for name in package.__all__} & set(SOURCES)


def test_importing_the_package_does_not_load_torch():
    code = "import sys, moe_policy; assert 'torch' not in sys.modules and 'sklearn' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_no_public_name_loads_matplotlib():
    code = """
import sys
from moe_policy import *
from ocp_envs import *
assert "matplotlib" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_plans_and_actions_do_not_need_torch():
    code = """
import sys
import moe_policy
moe_policy.load("PendulumSwingup-v0", "moe-custom")([3.0, 0.0])
moe_policy.load("PendulumSwingup-v0", "sac").predict([3.0, 0.0])
assert "torch" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_the_version_is_that_of_the_project():
    assert "dynamic" in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert ocp_envs.__version__ == moe_policy.__version__ == "0.1.0"


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = moe_policy.nothing
