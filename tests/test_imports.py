"""The direction of the imports: the plan of the house, enforced."""

from __future__ import annotations

import ast
import graphlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ocp_envs", "moe_policy")
#: Top-down, as in the plan; a module may import only from modules above it. A package stands for its __init__.py.
ORDER = (
    "ocp_envs.system",
    "ocp_envs.batch",
    "ocp_envs.trajectory",
    "ocp_envs.picture",
    "ocp_envs.symmetry",
    "ocp_envs.problem",
    "ocp_envs.suggestions",
    "ocp_envs.problems.pendulum",
    "ocp_envs.problems.vehicle",
    "ocp_envs.problems.quadcopter",
    "ocp_envs.problems",
    "ocp_envs.files",
    "ocp_envs.tables",
    "ocp_envs.transcription",
    "ocp_envs.scratch",
    "ocp_envs.compilation",
    "ocp_envs.nlp",
    "ocp_envs.guard",
    "ocp_envs.guesses",
    "ocp_envs.check",
    "ocp_envs.accuracy",
    "ocp_envs.solutions",
    "ocp_envs.solver",
    "ocp_envs.database",
    "ocp_envs.chunks",
    "ocp_envs.rounds",
    "ocp_envs.workers",
    "ocp_envs.free_paths",
    "ocp_envs.sampling",
    "ocp_envs.generation",
    "ocp_envs.reference",
    "ocp_envs.boundary",
    "ocp_envs.outside",
    "ocp_envs.hard_sets",
    "ocp_envs.splits",
    "ocp_envs.records",
    "ocp_envs.simulation",
    "ocp_envs.settings",
    "ocp_envs.space",
    "ocp_envs.rendering",
    "ocp_envs.description",
    "ocp_envs.vector_env",
    "ocp_envs.env",
    "ocp_envs",
    "moe_policy.architectures",
    "moe_policy.scaling",
    "moe_policy.checkpoint",
    "moe_policy.networks",
    "moe_policy.clustering",
    "moe_policy.fitting",
    "moe_policy.store",
    "moe_policy.policy",
    "moe_policy.planner",
    "moe_policy.optimal",
    "moe_policy.preparation",
    "moe_policy.training",
    "moe_policy.recipes",
    "moe_policy.lqr",
    "moe_policy.resampling",
    "moe_policy.tracking",
    "moe_policy.episodes",
    "moe_policy.rollout",
    "moe_policy",
    "moe_policy.wrappers",
    "moe_policy.vec_env",
    "moe_policy.actor",
    "moe_policy.learners",
    "moe_policy.curves",
    "moe_policy.baselines",
    "moe_policy.studies",
    "moe_policy.margin",
    "moe_policy.symmetric",
    "moe_policy.evaluation",
    "moe_policy.diagnosis",
    "moe_policy.reporting",
    "moe_policy.budgets",
    "moe_policy.figures",
    "moe_policy.budget_figures",
    "moe_policy.trajectory_figures",
    "moe_policy.cases",
    "moe_policy.space_figures",
    "moe_policy.data_report",
    "moe_policy.comparison",
    "moe_policy.contestants",
    "moe_policy.split_report",
    "moe_policy.split_figures",
    "moe_policy.latency",
    "moe_policy.robustness",
    "moe_policy.robustness_figures",
    "moe_policy.gallery",
    "moe_policy.summary",
)
LEARNING = {"moe_policy", "torch", "sklearn", "safetensors", "stable_baselines3"}
DECLARATION = ("ocp_envs.system", "ocp_envs.trajectory", "ocp_envs.problem", "ocp_envs.problems")
OPTIMISER = ("ocp_envs.transcription", "ocp_envs.nlp", "ocp_envs.guard", "ocp_envs.solver", "ocp_envs.generation")
SIMULATOR = ("ocp_envs.simulation", "ocp_envs.env", "ocp_envs.vector_env")


def _sources() -> dict[str, Path]:
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


SOURCES = _sources()


def _imported(path: Path) -> set[str]:
    """Everything a file imports, anywhere in it; of our own modules their full names."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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


def test_no_circle():
    list(graphlib.TopologicalSorter(GRAPH).static_order())  # raises CycleError, naming the circle


def test_every_module_has_its_place_once():
    assert sorted(ORDER) == sorted(SOURCES)


def test_modules_import_only_from_above():
    place = {module: i for i, module in enumerate(ORDER)}
    wrong = [
        f"{module} imports {name}"
        for module, names in GRAPH.items()
        for name in names
        if module in place and name in place and place[name] >= place[module]
    ]
    assert not wrong


@pytest.mark.parametrize("module", sorted(SOURCES))
def test_environments_know_nothing_of_learning_and_nothing_imports_scripts(module):
    assert not _roots(module) & {"scripts", "tests"}
    if module.startswith("ocp_envs"):
        assert not _roots(module) & LEARNING


@pytest.mark.parametrize(
    ("modules", "unknown"),
    [(DECLARATION, (*OPTIMISER, *SIMULATOR)), (OPTIMISER, SIMULATOR), (SIMULATOR, OPTIMISER)],
    ids=["declaration", "optimiser", "simulator"],
)
def test_problem_optimiser_and_simulator_do_not_know_each_other(modules, unknown):
    for module in set(modules) & set(SOURCES):
        assert not _reachable(module) & set(unknown), module


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


def test_the_function_rollout_is_not_hidden_by_its_module():
    code = "import moe_policy.rollout, moe_policy.tracking, moe_policy; assert callable(moe_policy.rollout)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_importing_the_package_does_not_load_torch():
    code = "import sys, moe_policy; assert 'torch' not in sys.modules and 'sklearn' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_an_unknown_name_is_an_attribute_error():
    import moe_policy

    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = moe_policy.nothing
