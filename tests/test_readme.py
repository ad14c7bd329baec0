"""README, the page of results and the documentation tell the truth: tables, links, code and tree."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ocp_envs", "moe_policy")
TABLE = re.compile(r"<!-- table: (\S+)(?: \w+)? -->\n(.*?)<!-- end -->", re.DOTALL)
PYTHON = re.compile(r"(<!-- run -->\n)?```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TREE = re.compile(r"<!-- tree -->\n```\w*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)[^)]*\)")
#: A path from the root; a placeholder such as results/compare_<env>.json counts as its folder.
PATH = re.compile(rf"(?<![\w./-])((?:{'|'.join((*PACKAGES, 'scripts', 'tests', 'results'))})/[\w./-]*)([<{{*]?)")


def _script(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGES = {page: (ROOT / page).read_text(encoding="utf-8") for page in _script("render_readme").PAGES}
#: All pages, those without tables too.
TEXTS = PAGES | {
    f"docs/{path.name}": path.read_text(encoding="utf-8")
    for path in (ROOT / "docs").glob("*.md")
    if path.name != "results.md"  # derived from results/README.md
}
#: Folders of pages that are derived: of the environments, and of the public names.
DERIVED = ("docs/environments/", "docs/api/", "docs/results.md")


# -- tables ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES)
def test_every_table_is_marked_at_both_ends(page):
    text = PAGES[page]
    assert TABLE.findall(text), f"{page} has no block between <!-- table: NAME --> and <!-- end -->"
    assert text.count("<!-- table:") == text.count("<!-- end -->") == len(TABLE.findall(text))


@pytest.mark.parametrize(
    ("page", "number"), [(page, i) for page, text in PAGES.items() for i in range(len(TABLE.findall(text)))]
)
def test_tables_are_those_of_the_records(page, number):
    block, name = list(TABLE.finditer(PAGES[page]))[number].group(0, 1)
    records = list((ROOT / "results").glob(f"{name}.json"))
    assert records, f"{page} has a table of results/{name}.json, which does not exist"
    assert _script("render_readme").render(block) == block, "run python scripts/render_readme.py"


# -- paths -------------------------------------------------------------------------------------------------------------


def _targets():
    return sorted({(page, target) for page, text in TEXTS.items() for target in LINK.findall(text)})


def _anchors(text):
    """The anchors that a page's headings get."""
    titles = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize(("page", "target"), [pair for pair in _targets() if not re.match(r"[a-z]+:", pair[1])])
def test_links_lead_somewhere(page, target):
    path, _, anchor = target.partition("#")
    assert not PurePosixPath(path).is_absolute()
    there = ROOT / page if not path else (ROOT / page).parent / path
    if f"docs/{path}".startswith(DERIVED):
        pytest.skip("a derived page: the build of the documentation checks the link")
    assert there.exists(), f"{page} links to {target}"
    assert not anchor or anchor in _anchors(there.read_text(encoding="utf-8")), f"{page} links to {target}"


@pytest.mark.parametrize("page", TEXTS)
def test_paths_in_the_text_exist(page):
    named = set()
    for path, placeholder in PATH.findall(TEXTS[page]):
        named.add(path.rpartition("/")[0] if placeholder else path.rstrip("."))
    assert named or page not in PAGES
    assert not sorted(path for path in named if not (ROOT / path).exists())


# -- code --------------------------------------------------------------------------------------------------------------


def test_all_code_is_python():
    for text in TEXTS.values():
        for _, code in PYTHON.findall(text):
            ast.parse(code)


def _marked(text):
    """The code that is marked to run; line numbers are those of the page."""
    source = ""
    for block in PYTHON.finditer(text):
        if block[1]:
            line = text.count("\n", 0, block.start(2))
            source += "\n" * (line - source.count("\n")) + block[2]
    return source


@pytest.mark.parametrize(
    "page", ["README.md", *(page for page in TEXTS if page != "README.md" and _marked(TEXTS[page]))]
)
def test_marked_code_runs(page, tmp_path):
    """In order, in one namespace, in an empty folder; line numbers of errors are those of the page."""
    source = _marked(TEXTS[page])
    assert source, f"{page} has no block ```python after a line <!-- run -->"
    environment = os.environ | {"MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}
    result = subprocess.run(
        [sys.executable, "-c", source], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stderr[-3000:]


# -- the tree ----------------------------------------------------------------------------------------------------------


def _tree():
    """Paths of the tree, folders with a slash at the end."""
    block = TREE.search(TEXTS["docs/contributing.md"])
    assert block, "docs/contributing.md has no code block after a line <!-- tree -->"
    paths, folders = [], []
    for line in block[1].splitlines():
        if not line.strip():
            continue
        depth, odd = divmod(len(line) - len(line.lstrip(" ")), 2)
        name = line.split()[0]
        assert not odd, f"two spaces a level are expected, got {line!r}"
        assert depth <= len(folders), f"no folder is above {line!r}"
        del folders[depth:]
        paths.append("".join(folders) + name)
        if name.endswith("/"):
            folders.append(name)
    return paths


def test_the_tree_names_every_wing_and_every_module_at_a_root():
    named = _tree()
    assert len(set(named)) == len(named)
    for package in PACKAGES:
        for path in (ROOT / package).iterdir():
            name = f"{package}/{path.name}"
            if path.is_dir() and path.name != "__pycache__":
                assert f"{name}/" in named
            elif path.suffix == ".py" and path.name != "__init__.py":
                assert name in named


def test_everything_in_the_tree_exists():
    for path in _tree():
        assert (ROOT / path).is_dir() if path.endswith("/") else (ROOT / path).is_file(), path
