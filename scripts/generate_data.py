"""Solve the training, development and validation instances of a problem into databases under ``data/<env>/``.

After an interruption the same command resumes. ``--scheduler`` runs the solves on a Dask cluster, whose workers need
the same versions of the packages; this process alone writes files. Writes ``generation_<env>.json``. With ``--ship``
also the parameters and reference costs in the package.

    python scripts/generate_data.py
    python scripts/generate_data.py --env GroundVehicle-v0 --scheduler tcp://head-node:8786
"""

import argparse
import contextlib
import os
import time
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.generation import Generation, Memory, SplitGeneration, Totals
from moe_policy.reports.records import read, write
from ocp_envs.data.database import Database
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.splits import sets_of
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import provenance

#: Seconds to wait for a scheduler, and then for a worker.
CONNECT_LIMIT, WORKER_LIMIT = 30, 120
SCHEDULER = (
    "address of a Dask scheduler, such as tcp://host:8786; whoever reaches its port can run any program on every "
    "worker, so keep it within a network that you trust"
)
#: Packages whose versions affect the results.
DECISIVE = ("ocp-moe", "casadi", "numpy", "scipy")


def connect(address: str) -> Any:
    """A client of the Dask cluster at ``address``, with workers that have the versions of this process."""
    cli.need("distributed")
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_LIMIT)
    except (OSError, ValueError) as error:
        raise SystemExit(f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`") from None
    fault = fault_of(client, address)
    if fault:
        client.close()
        raise SystemExit(fault)
    cli.say(f"{len(client.ncores())} workers with {sum(client.ncores().values())} threads at {address}")
    return client


def fault_of(client: Any, address: str) -> str | None:
    """What is wrong with the workers; ``None`` if nothing is."""
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


def generate(name: str, arguments: argparse.Namespace, client: Any) -> None:
    """Generate the database of the split ``name``; write its record, and with ``--ship`` the reference."""
    problem: OptimalControlProblem = arguments.problem
    split, path = sets_of(problem).split(name), arguments.data / problem.id / f"{name}.zarr"
    stored = Database.open(path, problem) if path.exists() else None
    begun = stored.totals()["problems"] if stored else 0
    # Drawing takes an optimiser for some problems: a database that was begun contains the draws of its seed.
    drawn = stored is not None and len(stored.parameters) == len(split) and stored.settings["seed"] == split.seed
    began = time.perf_counter()
    database = ocp_envs.generate(
        problem,
        path,
        stored.parameters if stored and drawn else split.parameters(problem),
        executor=client.get_executor() if client else None,
        workers=arguments.workers,
        seed=split.seed,
        settings=split.settings,
    )
    seconds, totals = time.perf_counter() - began, Totals.of(database)
    cli.say(
        f"{name}: {totals.solved} of {totals.problems} instances solved in {seconds:.1f} s; "
        f"{totals.solves} solves, {totals.failures} failed, {totals.fallbacks} went to the second solver"
    )
    if arguments.ship and name in reference.SHIPPED:
        cli.say(f"wrote {reference.save(database, name)}")
    workers = sum(client.ncores().values()) if client else arguments.workers or os.cpu_count() or 1
    made = SplitGeneration(
        totals=totals,
        seconds=seconds,
        problems_per_second=totals.problems / seconds,
        resumed_from=begun,
        workers=workers,
        cluster=client is not None,
        settings=database.settings,
        digest=database.digest(),
        memory=Memory.peak(0 if client else workers),
        provenance=provenance(),
    )
    output = arguments.results / f"generation_{problem.id}.json"
    earlier = read(output, Generation, Generation(splits={}))
    write(output, replace(earlier, splits=earlier.splits | {name: made}))


def main() -> None:
    ship = "write the reference of each set into the package, and the record into results/"
    parser = cli.parser(__doc__, data=True, workers=True, ship=ship)
    parser.add_argument("--splits", nargs="+", help="names of the sets; all by default")
    parser.add_argument("--scheduler", help=SCHEDULER)
    arguments = parser.parse()
    sets = sets_of(arguments.problem)
    with cli.option("--splits"):
        names = [name for name in arguments.splits or sets.splits if sets.split(name)]

    with connect(arguments.scheduler) if arguments.scheduler else contextlib.nullcontext() as client:
        began = time.perf_counter()
        with GuardedSolver(arguments.problem) as solver:
            solver.start()
        cli.say(f"solver functions ready after {time.perf_counter() - began:.1f} s")
        for name in names:
            generate(name, arguments, client)


if __name__ == "__main__":
    cli.run(main, continues=True)
