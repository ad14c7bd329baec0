"""Make the hard sets of an environment with their reference costs, and write them into the package.

``boundary``: problems next to the jump of the optimum; ``outside``: problems beyond the parameter box. What they are
exactly stands in ``ocp_envs/splits.py``. Databases go to ``data/<env-id>/hard/``, and the same command goes on where an
earlier one was interrupted; parameters and costs go to ``ocp_envs/reference/<env-id>/<set>.npz``, and what it took to
``results/splits_<env-id>.json``.

    python scripts/make_splits.py --env GroundVehicle-v0
    python scripts/make_splits.py --splits boundary --cases 20 --tables /tmp/tables --results /tmp
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import ocp_envs
from ocp_envs import tables
from ocp_envs.sets import reference
from ocp_envs.sets.making import make, smaller
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--splits", nargs="+", help="which sets; all by default")
    parser.add_argument("--cases", type=int, help="fewer problems, to try it out; then --tables must be given")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--tables", type=Path, default=tables.FOLDER, help="folder of the tables; the package's own")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the record")
    arguments = parser.parse_args()
    if arguments.cases and arguments.tables == tables.FOLDER:
        parser.error("--cases makes smaller sets than the package's own; give another folder with --tables")

    problem = ocp_envs.load(arguments.env)
    chosen = {name: sets_of(problem).hard_set(name) for name in arguments.splits or sets_of(problem).hard}
    folder = arguments.data / problem.id / "hard"
    if arguments.cases:
        chosen = {name: smaller(hard, arguments.cases) for name, hard in chosen.items()}
        folder /= str(arguments.cases)
    for name, hard in chosen.items():
        resumed, began = (folder / f"{name}.zarr").exists(), time.perf_counter()
        found, record = make(problem, name, hard, folder, arguments.workers)
        seconds = time.perf_counter() - began
        print(f"wrote {reference.write(problem, name, found, arguments.tables)}")
        print(f"{name}: {len(found)} of {record['candidates']} candidates, {seconds:.0f} s", flush=True)
        record |= {"seconds": seconds, "resumed": resumed, "workers": arguments.workers, "provenance": provenance()}
        path = arguments.results / f"splits_{problem.id}.json"
        earlier = json.loads(path.read_text()) if path.exists() else {}
        write_json(path, earlier | {name: record})


if __name__ == "__main__":
    main()
