"""Control steps, plans and solves per second, against the size of the batch and against the workers.

Batches are measured in one process on one thread; workers are one and two processes of the package's pool and, where
dask.distributed is installed, a Dask cluster of two processes on this machine. A batch of b rows takes about a + b · c:
the figure names a, the time of a call, which limits small batches, and c, the time of a row, which limits large ones.
Writes ``benchmark_scaling.json`` and ``benchmark_scaling.png``; takes about three minutes.

    python scripts/benchmark_scaling.py
"""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.figures.scaling import scaling_figure
from moe_policy.experiments.speed.scaling import PLANNER, QUANTITIES, Scaling, batch_row, worker_row
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance

#: Sizes of the batches, and the one with which workers are compared.
BATCHES = {"steps": (1, 8, 64, 512, 4096, 32768), "plans": (1, 8, 64, 512, 4096), "solves": (1, 4, 16, 64)}
OF_WORKERS = {"steps": 4096, "plans": 4096, "solves": 16}
#: Rounds in which workers are compared.
ROUNDS = 3


@contextmanager
def executors() -> Iterator[dict[str, tuple[Executor, int]]]:
    """Executors by name, each with the number of its workers."""
    with WorkerPool(1) as one, WorkerPool(2) as two:
        found: dict[str, tuple[Executor, int]] = {"1 process": (one, 1), "2 processes": (two, 2)}
        if find_spec("distributed") is None:
            yield found
            return
        from distributed import Client, LocalCluster

        with LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
            yield {**found, "Dask, 2 processes": (client.get_executor(pure=False), 2)}


def main() -> None:
    parser = cli.parser(__doc__, env=None)
    parser.add_argument("--seconds", type=float, default=0.5, help="how long each rate is measured; default 0.5")
    seconds = (arguments := parser.parse()).seconds
    os.environ["OMP_NUM_THREADS"] = "1"  # of the workers, which are started below

    cases = [(quantity, env_id) for quantity in QUANTITIES for env_id in ocp_envs.names()]
    with executors() as pools:
        alone, _ = pools["1 process"]
        batches, workers = [], []
        for case in cases:
            row = batch_row(alone, *case, BATCHES[case[0]], seconds)
            batches.append(row)
            cli.say(f"{case[1]}: " + ", ".join(f"{rate:,.0f} {case[0]}/s ({b})" for b, rate in row.per_second.items()))
        for case in cases:
            together = worker_row(pools, *case, OF_WORKERS[case[0]], seconds, ROUNDS)
            workers.append(together)
            shown = ", ".join(f"{ratio:.2f} ({name})" for name, ratio in together.ratio_to_one.items())
            cli.say(f"{case[1]}: {case[0]} of workers / of one: {shown}")
    record = Scaling(
        planner=PLANNER,
        seconds=seconds,
        rounds=ROUNDS,
        batches=tuple(batches),
        workers=tuple(workers),
        provenance=provenance(),
    )
    cli.publish(arguments, "benchmark_scaling", record)
    cli.say(f"wrote {scaling_figure(record, arguments.results / 'benchmark_scaling.png')}")


if __name__ == "__main__":
    cli.run(main)
