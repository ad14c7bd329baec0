"""How many control steps, plans and solves there are a second, against the size of the batch and the workers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from moe_policy.experiments.speed.solver import ON_ONE_CORE, draw
from moe_policy.reports.records import Record
from moe_policy.store import load_planner
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import load
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.provenance import Provenance

#: Seed of all instances, and how many of them are solved in turn.
_SEED, _SOLVED = 909, 32
#: The shipped planner that plans.
PLANNER = "snn"
#: One call, for a whole batch.
Call = Callable[[], object]


@dataclass(frozen=True, kw_only=True)
class BatchRow(Record):
    """Rates of one quantity of one problem in one process, by size of the batch.

    A batch of b rows takes about ``call_seconds`` + b · ``row_seconds``: the first limits small batches, the second
    large ones.
    """

    env_id: str
    quantity: str
    per_second: dict[str, float]
    call_seconds: float
    row_seconds: float


@dataclass(frozen=True, kw_only=True)
class WorkerRow(Record):
    """Rates of one quantity of one problem in batches of one size, by workers, all of them together."""

    env_id: str
    quantity: str
    batch: int
    per_second: dict[str, float]
    ratio_to_one: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Scaling(Record):
    """Rates against the size of the batch, and against the workers.

    Each was measured for ``seconds``, those of workers in so many interleaved ``rounds``.
    """

    planner: str
    seconds: float
    rounds: int
    batches: tuple[BatchRow, ...]
    workers: tuple[WorkerRow, ...]
    provenance: Provenance


@contextmanager
def _steps(problem: OptimalControlProblem, batch: int) -> Iterator[Call]:
    """Control steps of a vector environment, with observations, rewards and resets."""
    envs = VectorEnv(problem, batch)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = envs.action_space.sample()
    yield lambda: envs.step(actions)


@contextmanager
def _plans(problem: OptimalControlProblem, batch: int) -> Iterator[Call]:
    """Plans of the shipped network."""
    planner, p = load_planner(problem, PLANNER), problem.parameters.draw(np.random.default_rng(_SEED), batch)
    yield lambda: planner(p)


@contextmanager
def _solves(problem: OptimalControlProblem, batch: int) -> Iterator[Call]:
    """Solves from straight lines, guard and check included, of the same instances in turn, whatever the batch."""
    p, windings = draw(problem, _SOLVED, _SEED)
    guess = guesses(problem, p, windings, np.random.default_rng(_SEED), "line")
    order, done = np.random.default_rng(_SEED).permutation(len(p)), 0
    with GuardedSolver(problem, ON_ONE_CORE) as solver:

        def solve() -> None:
            nonlocal done
            rows = order[np.arange(done, done + batch) % len(p)]
            solver.solve(p[rows], guess[rows], windings[rows], retry_with_fallback=False)
            done += batch

        yield solve


#: What is counted, by name: of a problem and the size of a batch, the context of one call.
QUANTITIES = {"steps": _steps, "plans": _plans, "solves": _solves}


def rates(quantity: str, env_id: str, batches: Sequence[int], seconds: float) -> dict[int, float]:
    """Rate of ``quantity`` of the problem ``env_id`` for each size of ``batches``: medians over calls in ``seconds``.

    Those of solves, which differ by instance, are means.
    """
    return {batch: _rate(quantity, env_id, batch, seconds) for batch in batches}


def _rate(quantity: str, env_id: str, batch: int, seconds: float) -> float:
    taken: list[float] = []
    with QUANTITIES[quantity](load(env_id), batch) as call:
        call()  # compiles, starts processes
        began = time.perf_counter()
        while not taken or time.perf_counter() - began < seconds:
            before = time.perf_counter()
            call()
            taken.append(time.perf_counter() - before)
    return batch / float(np.mean(taken) if quantity == "solves" else np.median(taken))


def batch_row(executor: Executor, quantity: str, env_id: str, batches: Sequence[int], seconds: float) -> BatchRow:
    """The rates of ``quantity`` in a worker of ``executor``; the other arguments are those of :func:`rates`."""
    found = executor.submit(rates, quantity, env_id, batches, seconds).result()
    call, row = line_through({batch: batch / rate for batch, rate in found.items()})
    per_second = {str(batch): rate for batch, rate in found.items()}
    return BatchRow(env_id=env_id, quantity=quantity, per_second=per_second, call_seconds=call, row_seconds=row)


def line_through(seconds: Mapping[int, float]) -> tuple[float, float]:
    """Non-negative (a, b) with a + b · n ≈ ``seconds[n]``, whose relative errors have the least squares."""
    sizes, times = (np.array(each, np.float64) for each in (list(seconds), list(seconds.values())))
    if len(sizes) == 1:
        return 0.0, float(times[0] / sizes[0])
    from scipy.optimize import nnls

    (call, row), _ = nnls(np.stack([1 / times, sizes / times], axis=1), np.ones(len(times)))
    return float(call), float(row)


def worker_row(
    executors: Mapping[str, tuple[Executor, int]], quantity: str, env_id: str, batch: int, seconds: float, rounds: int
) -> WorkerRow:
    """The rates of ``quantity`` by name of ``executors``, the first with one worker: each with its number of workers.

    Every worker measures for ``seconds`` in batches of ``batch``, all of an executor at the same time. Executors take
    turns, and the medians of ``rounds`` count.
    """
    found: dict[str, list[float]] = {name: [] for name in executors}
    for _ in range(rounds + 1):
        for name, (executor, count) in executors.items():
            futures = [executor.submit(rates, quantity, env_id, [batch], seconds) for _ in range(count)]
            found[name].append(sum(future.result()[batch] for future in futures))
    total = {name: float(np.median(each[1:])) for name, each in found.items()}  # the first one starts processes
    first = next(iter(total.values()))
    ratio = {name: rate / first for name, rate in total.items()}
    return WorkerRow(env_id=env_id, quantity=quantity, batch=batch, per_second=total, ratio_to_one=ratio)
