"""How the documentation is built: ``sphinx-build docs build/docs`` from the root of the checkout."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

import generated
import references

import ocp_envs

project = "ocp-moe"
author = "the authors of ocp-moe"
version = release = ocp_envs.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinx.ext.viewcode"]
exclude_patterns = ["page", "methods"]
templates_path: list[str] = []

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence"]
myst_heading_anchors = 4  # anchors of headings as on the pages of the repository

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
python_use_unqualified_type_names = True
nitpicky = True
#: Names that modules have for annotations alone, and texts that Sphinx reads as names.
nitpick_ignore_regex = [
    ("py:class", "BaseAlgorithm|SB3VecEnv|Model|PlannerModel|PolicyModel|Linear"),
    ("py:obj", r"typing\.Literal\[.*"),
    ("py:class", r"collections\.abc\.\w+\[.*"),
]

html_theme = "furo"
html_title = f"ocp-moe {release}"
html_static_path: list[str] = []


def copy_page(app: Sphinx, error: Exception | None) -> None:
    """Put the page that runs in the browser beside the built pages, as it is."""
    if error is None:
        shutil.copytree(DOCS / "page", Path(app.outdir) / "page", dirs_exist_ok=True)


def link_results(app: Sphinx, name: str, source: list[str]) -> None:
    """Let what leads to the page of results in the repository lead to that of the documentation."""
    source[0] = source[0].replace("](../results/README.md", "](results.md").replace("](../README.md", "](index.md")


def setup(app: Sphinx) -> None:
    """Write the pages that are derived from the code, and resolve what docstrings refer to."""
    generated.write(DOCS)
    app.connect("source-read", link_results)
    app.connect("build-finished", copy_page)
    app.connect("autodoc-process-docstring", references.separate, priority=400)
    app.connect("missing-reference", references.resolve)
