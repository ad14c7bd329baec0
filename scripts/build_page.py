"""Build the page in the browser, which needs no server: planners, regulators and simulators of some problems.

The folder ``runs/page``, with ``--ship`` ``docs/page``, gets ``index.html`` and one file of data for each problem.
Sources are in ``moe_policy/experiments/page/source``. The exported regulators and the simulators are compiled to
WebAssembly, with clang and lld (``apt-get install clang lld``).

    python scripts/build_page.py
    python scripts/build_page.py --problems pendulum vehicle sphere
"""

import json
from collections.abc import Sequence
from pathlib import Path

from moe_policy.experiments import cli
from moe_policy.experiments.page.bundle import SOURCES, page
from moe_policy.experiments.page.contents import SHOWN, USUAL, contents
from ocp_envs.support.files import replacing

BUILT = cli.ROOT / "docs" / "page"


def write(path: Path, text: str) -> None:
    """Replace the file at ``path`` by ``text``, and print its size."""
    with replacing(path) as file:
        file.write(text.encode())
    print(f"{path}  {path.stat().st_size / 1e3:,.0f} kB")


def build(problems: Sequence[str], folder: Path) -> None:
    """Write the page that shows ``problems`` into a ``folder``."""
    for name in problems:
        data = json.dumps(contents(SHOWN[name], SOURCES / "c"), separators=(",", ":"), allow_nan=False)
        write(folder / f"{name}.js", f'receive("{name}", {data});\n')
    write(folder / "index.html", page(SOURCES, problems))


def main() -> None:
    parser = cli.parser(__doc__, env=None, ship="write into docs/page, the committed page, instead of runs/page")
    which = f"of {', '.join(SHOWN)}; by default {' and '.join(USUAL)}"
    parser.add_argument("--problems", nargs="+", metavar="NAME", choices=SHOWN, default=USUAL, help=which)
    arguments = parser.parse()
    build(arguments.problems, BUILT if arguments.results == cli.RECORDS else arguments.results / "page")


if __name__ == "__main__":
    cli.run(main)
