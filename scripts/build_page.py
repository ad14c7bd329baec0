"""Build the page in the browser, which needs no server: planners, regulators and simulators of some problems.

The folder ``runs/page``, with ``--ship`` ``docs/page``, gets ``index.html`` and one file of data for each problem.
Sources are in ``page/``. The exported regulators and the simulators are compiled to WebAssembly, with clang and lld
(``apt-get install clang lld``).

    python scripts/build_page.py
    python scripts/build_page.py --ship --problems pendulum
"""

import json
from pathlib import Path

from moe_policy.experiments import cli
from moe_policy.experiments.page.bundle import page
from moe_policy.experiments.page.contents import SHOWN, contents
from ocp_envs.support.files import replacing

SOURCES, BUILT = cli.ROOT / "page", cli.ROOT / "docs" / "page"


def write(path: Path, text: str) -> None:
    """Replace the file at ``path`` by ``text``, and print its size."""
    with replacing(path) as file:
        file.write(text.encode())
    print(f"{path}  {path.stat().st_size / 1e3:,.0f} kB")


def main() -> None:
    parser = cli.parser(__doc__, env=None, ship="write into docs/page, the committed page, instead of runs/page")
    parser.add_argument(
        "--problems", nargs="+", metavar="NAME", choices=SHOWN, default=list(SHOWN), help="all by default"
    )
    arguments = parser.parse()
    folder = BUILT if arguments.results == cli.RECORDS else arguments.results / "page"
    for name in arguments.problems:
        data = json.dumps(contents(SHOWN[name], SOURCES / "c"), separators=(",", ":"), allow_nan=False)
        write(folder / f"{name}.js", f'receive("{name}", {data});\n')
    write(folder / "index.html", page(SOURCES))


if __name__ == "__main__":
    cli.run(main)
