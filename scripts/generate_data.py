"""Solve the training, development and validation problems of an environment into databases under ``data/<env-id>/``.

Interrupted at any moment, the same command goes on where it stopped. ``--scheduler`` runs the solves on a Dask cluster,
whose workers need the same versions of the packages; files are written here alone.
``--ship`` also writes the parameters and reference costs that the package carries, and what the generation took to
``results/generation_<env-id>.json``.

    python scripts/generate_data.py
    python scripts/generate_data.py --env GroundVehicle-v0 --scheduler tcp://head-node:8786
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import time
from concurrent.futures import BrokenExecutor
from importlib.metadata import version
from pathlib import Path
from typing import Any

import ocp_envs
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.splits import split_of, splits_of
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import peak_memory_gb, provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
#: Seconds to wait for a scheduler, and then for a worker.
CONNECT_LIMIT, WORKER_LIMIT = 30, 120
#: Packages whose versions decide the results.
DECISIVE = ("ocp-moe", "casadi", "numpy", "scipy")


def read_record(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def connect(address: str) -> Any:
    """A client of the Dask cluster at ``address``, with workers that have the versions of this process."""
    try:
        from distributed import Client
    except ImportError:
        raise SystemExit('--scheduler needs Dask: pip install "ocp-moe[cluster]"') from None
    try:
        client = Client(address, timeout=CONNECT_LIMIT)
    except (OSError, ValueError) as error:
        raise SystemExit(f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`") from None
    fault = fault_of(client, address)
    if fault:
        client.close()
        raise SystemExit(fault)
    print(f"{len(client.ncores())} workers with {sum(client.ncores().values())} threads at {address}")
    return client


def fault_of(client: Any, address: str) -> str | None:
    """What is wrong with the workers, if anything."""
    try:
        client.wait_for_workers(1, timeout=WORKER_LIMIT)
    except TimeoutError:
        return f"{address} has no workers; start some with `dask worker {address}`"
    for package in DECISIVE:
        here = version(package)
        for worker, there in client.run(version, package).items():
            if there != here:
                return (
                    f"worker {worker} has {package} {there}, this process {here}; install the same version everywhere"
                )
    return None


def peak_memory(workers: int) -> dict[str, float]:
    """Largest memory so far in GB: of this process, of the largest of its descendants, and a bound of all."""
    own, largest = peak_memory_gb(), peak_memory_gb(descendants=True)
    # Every worker has a solver child.
    return {"parent_gb": own, "largest_child_gb": largest, "bound_gb": own + 2 * workers * largest}


def generate(name: str, arguments: argparse.Namespace, problem: OptimalControlProblem, client: Any) -> None:
    """Make the split called ``name``, print what came out, and ship it where that was asked for."""
    split, path = split_of(problem, name), arguments.data / problem.id / f"{name}.zarr"
    stored = Database.open(path, problem) if path.exists() else None
    begun = stored.totals()["problems"] if stored else 0
    # Drawing takes an optimiser for some problems: a database that was begun has the draws of its seed already.
    drawn = stored is not None and len(stored.parameters) == len(split) and stored.settings["seed"] == split.seed
    parameters = stored.parameters if stored and drawn else split.parameters(problem)
    began = time.perf_counter()
    database = ocp_envs.generate(
        problem,
        path,
        parameters,
        executor=client.get_executor() if client else None,
        workers=arguments.workers,
        seed=split.seed,
        settings=split.settings,
    )
    seconds = time.perf_counter() - began
    totals = database.totals()
    print(
        f"{name}: {totals['solved']} of {totals['problems']} problems solved in {seconds:.1f} s; "
        f"{totals['solves']} solves, {totals['failures']} failed, {totals['fallbacks']} went to the second solver"
    )
    if not arguments.ship:
        return
    if name in reference.SHIPPED:
        print(f"wrote {reference.save(database, name)}")
    workers = sum(client.ncores().values()) if client else arguments.workers or os.cpu_count() or 1
    record = read_record(arguments.results / f"generation_{problem.id}.json")
    record[name] = totals | {
        "seconds": seconds,
        "problems_per_second": totals["problems"] / seconds,
        "resumed_from": begun,
        "workers": workers,
        "cluster": client is not None,
        "settings": database.settings,
        "digest": database.digest(),
        "memory": peak_memory(0 if client else workers),
        "provenance": provenance(),
    }
    write_json(arguments.results / f"generation_{problem.id}.json", record)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--splits", nargs="+", help="which sets; all by default")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--workers", type=int, help="processes; one per core by default")
    parser.add_argument("--scheduler", help="address of a Dask scheduler, such as tcp://host:8786")
    parser.add_argument("--ship", action="store_true", help="write the package's reference files")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the record")
    arguments = parser.parse_args()

    problem = ocp_envs.load(arguments.env)
    with connect(arguments.scheduler) if arguments.scheduler else contextlib.nullcontext() as client:
        began = time.perf_counter()
        with GuardedSolver(problem) as solver:
            solver.start()
        print(f"solver functions ready after {time.perf_counter() - began:.1f} s")
        try:
            for name in arguments.splits or splits_of(problem):
                generate(name, arguments, problem, client)
        except BrokenExecutor as error:
            raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
