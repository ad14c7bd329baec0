"""The pages that the documentation derives from the code: they name what there is, without building anything."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

import moe_policy
import ocp_envs
from ocp_envs.problems import BENCHMARK

DOCS = Path(__file__).resolve().parents[1] / "docs"


def _generated():
    spec = importlib.util.spec_from_file_location("generated", DOCS / "generated.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_public_name_has_a_place():
    listed = {name for names in _generated().public_names().values() for name in names}
    public = {f"{package.__name__}.{name}" for package in (ocp_envs, moe_policy) for name in package.__all__}
    assert listed == public


def test_the_page_of_a_wing_has_its_names():
    page = _generated().reference("ocp_envs.sets", ["ocp_envs.sample", "ocp_envs.ReferenceSet"])
    assert page.startswith("Sets of instances\n=====")
    assert ".. autofunction:: ocp_envs.sample" in page
    assert ".. autoclass:: ocp_envs.ReferenceSet" in page


def test_every_environment_has_a_page_with_its_animation():
    for problem in BENCHMARK:
        page = _generated().environment(problem.id)
        assert page.startswith(f"# {problem.id}\n\n![An optimal episode](../animations/{problem.id}.webp)\n")


def test_what_pages_link_to_in_html_is_there():
    """The build of the documentation checks the links of Markdown alone."""
    links = [
        (path, link) for path in DOCS.glob("*.md") for link in re.findall(r'(?:href|src)="([^"]+)"', path.read_text())
    ]
    assert links
    assert [(path.name, link) for path, link in links if "://" not in link and not (DOCS / link).exists()] == []


def test_links_of_the_results_lead_from_the_folder_of_the_documentation():
    page = _generated().results()
    assert "](../results/" in page
    assert "](../docs/" not in page


@pytest.mark.parametrize("package", [ocp_envs, moe_policy], ids=lambda package: package.__name__)
def test_the_help_of_a_package_names_what_exists(package):
    words = set(re.findall(r"``(\w+)``", package.__doc__))
    assert len(words) > 15
    extras, other = {"rl", "minari"}, {each.__name__ for each in (ocp_envs, moe_policy)}
    assert not words - set(package.__all__) - extras - other
