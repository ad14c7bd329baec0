"""Generation of databases: multistart on a first subset, then warm starts from neighbours, in rounds.

The instances are put into a random order and solved in rounds of n₀, 2n₀, 4n₀ … instances. The first round tries every
winding of the goal from several guesses. In a later round each instance considers its nearest neighbours among the
instances of *earlier* rounds, takes from them the solution families that have the lowest or nearly the lowest cost
there, and starts each family from the solutions of the nearest neighbours that have it (Tang & Hauser, section III-B,
after Tang, Sun & Hauser's nearest-neighbour method). The result therefore depends on the instance, the settings and the
seed alone, and not on the number of workers or on interruptions.

A task is a chunk of instances with their guesses. Only the calling process writes, and only one process at a time may.
A killed worker costs its chunk, a killed parent the chunks in flight; the same call resumes from there.
"""

from __future__ import annotations

import os
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError, StoredRows
from ocp_envs.data.locks import only_writer
from ocp_envs.data.probe import PROBED, probe
from ocp_envs.data.refinement import REFINED
from ocp_envs.data.rounds import first_rows, rounds, tasks
from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.data.worker import Chunk, solve_chunk
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.fidelity import Fidelity, fidelity
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.progress import Progress, duration
from ocp_envs.support.tasks import TaskRun, workers_of
from ocp_envs.support.workers import Workers

#: Instances of a generation that is worth a probe, where progress is shown.
_WORTH_A_PROBE = 10 * PROBED
#: How far the caller of :func:`generate` is above the function that warns.
_CALLER = 4


@checked
def generate(
    problem: ProblemOrId,
    path: str | os.PathLike[str],
    parameters: ArrayLike,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    seed: int = 0,
    settings: GenerationSettings = DEFAULT_GENERATION,
    extrapolate: bool = False,
    progress: bool | None = None,
) -> Database:
    """Solve the problem for all parameters and store the best trajectory of every solution family.

    The same call resumes where an earlier one was interrupted. A call whose parameters begin with those of a finished
    database, in the same order, adds the others: only these are solved, and what is stored of the first stays equal bit
    by bit. Rounds and chunks stay where they are, so a database that grew at a multiple of ``settings.chunk`` equals
    one that was generated at once in its order of rows. It differs from one that :func:`generate` makes at once, which
    puts all instances into random order. What it holds depends on the sizes to which it grew, the settings and the
    seed, and not on interruptions or workers. With the default executor the calling script needs
    Python's usual ``if __name__ == "__main__":``.

    Args:
        problem: what to solve; it need not be registered.
        path: folder of the database.
        parameters: (M, np); the first of them may be stored already. Those that whole turns of angles bring into the
            box are solved and stored there.
        executor: any ``concurrent.futures`` executor, such as a Dask cluster's ``client.get_executor()``; by default a
            pool of processes. If it breaks, its error is raised and every finished chunk is stored.
        workers: processes of the default pool, or tasks that ``executor`` runs at once; one per core where not given.
            A Dask cluster is asked for its threads instead.
        seed: of the order and of the guesses.
        settings: how many guesses and warm starts are tried, and how.
        extrapolate: accept parameters outside the box.
        progress: show it, as a bar on a terminal and elsewhere as a line a minute; by default on a terminal alone.
            Where it is shown, a few instances are probed first: how many of the guesses find the lowest cost, how many
            solves fail, and how long all will take. Nothing is chosen by it.

    Returns:
        the finished database.

    Raises:
        DatabaseError: the path holds something else, or a database made with other arguments, or another process is
            writing it.
        ValueError: parameters of the wrong shape, not finite, or outside the box.

    Warns:
        UserWarning: of the first solutions, Runge-Kutta substeps that are too few, or a path that enters a constraint
            between the knots.
    """
    problem = problem_of(problem)
    p, folder = problem.check_parameters(parameters, extrapolate), Path(path)
    outside = ~problem.parameters.contains(p)
    p[outside] = problem.in_one_turn(p[outside])[0]
    if folder.exists() and _complete(found := _open_or_create(problem, folder, p, seed, settings), p):
        return found
    with only_writer(folder):
        database = _open_or_create(problem, folder, p, seed, settings)
        begun = database.totals()["problems"]
        bar = Progress(len(p), unit="instance", label=problem.id, initial=begun, shown=progress)
        with bar, workers_of(executor, workers) as pool:
            with GuardedSolver(problem, settings.solver) as solver:
                solver.start()  # compiles, once, before workers ask for it
                if bar.shown and len(p) - begun >= _WORTH_A_PROBE:
                    _tell(solver, p, settings, pool, bar)
            _finish(database, settings, seed, pool, bar)
            if not _complete(database, p):
                database = _grown(database, p, seed)
                _finish(database, settings, seed, pool, bar)
    return database


def _tell(solver: GuardedSolver, p: Array, settings: GenerationSettings, pool: Workers, bar: Progress) -> None:
    """Say on ``bar`` what a probe of a few of the instances ``p`` finds, and how long all will take."""
    rows = np.linspace(0, len(p) - 1, PROBED).astype(np.int64)
    found = probe(solver, p[rows], settings)
    first, workers = min(first_rows(settings), len(p)), pool.in_flight() // 2
    expectation = found.expectation(first, workers)
    left = duration(expectation.left(0, len(p), 0, 0.0))
    bar.say(f"{solver.problem.id}: {found.text}; about {left} for {len(p):,} instances with {workers} workers")
    bar.expect(expectation)


def _complete(database: Database, p: Array) -> bool:
    """Whether ``database`` has all of the parameters ``p``, of which it has the first, and their solutions."""
    return len(database) == len(p) and database.complete


def _finish(database: Database, settings: GenerationSettings, seed: int, workers: Workers, bar: Progress) -> None:
    """Solve what is missing, round by round, and write each chunk as it arrives."""
    failed, infeasible = 0, 0

    def write(chunk: Chunk, rows: StoredRows) -> None:
        nonlocal failed, infeasible
        database.write(chunk.number, rows)
        infeasible += int((rows.status == Status.INFEASIBLE).sum())
        failed += int(((rows.status != Status.SOLVED) & (rows.status != Status.INFEASIBLE)).sum())
        bar.update(len(rows.status), failed=failed, **({"infeasible": infeasible} if infeasible else {}))

    run = TaskRun(solve_chunk, workers, write)
    for chunks in rounds(database, settings):
        begun = database.present()[chunks].all()
        run(tasks(database, settings, seed, chunks))
        if chunks.start == 0 and not begun:  # once, as early as there are solutions
            measured = fidelity_of(database)
            measured.warn(_CALLER)
            bar.say(f"{database.problem.id}: {measured.text}")


def fidelity_of(database: Database, count: int = 20) -> Fidelity:
    """What the solutions of the first ``count`` solved rows of ``database`` leave open between their knots."""
    rows = database.stored(database.stored_rows(0))
    solved = np.flatnonzero(rows.status == Status.SOLVED)[:count]
    z = rows.z[solved, rows.cost[solved].argmin(axis=1)]
    p = database.stored_parameters(database.stored_rows(0))[solved]
    return fidelity(database.problem, p, database.problem.unflatten(z))


def _grown(database: Database, p: Array, seed: int) -> Database:
    """The finished ``database`` with rows for those of ``p`` that it does not have."""
    known = len(database)
    order = known + np.random.default_rng((seed, known)).permutation(len(p) - known)
    return database.grow(p[known:], order)


def _open_or_create(
    problem: OptimalControlProblem, path: Path, p: Array, seed: int, settings: GenerationSettings
) -> Database:
    """The database at ``path`` for the parameters ``p`` or the first of them; a new one where there is none."""
    record = {"seed": seed, **settings.record()}
    if not path.exists():
        order = np.random.default_rng(seed).permutation(len(p))
        Database.create(path, problem, p, order=order, settings=record, chunk=settings.chunk)
    database = Database.open(path, problem)
    if fault := _fault(database, record, p):
        raise DatabaseError(f"{path} {fault}")
    return database


def _fault(database: Database, record: dict[str, object], p: Array) -> str:
    """Why ``database`` cannot become one with the settings ``record`` for the parameters ``p``, and what to do."""
    known, settings = database.parameters, database.settings
    if REFINED in settings:
        return (
            "was refined, and refined databases do not grow; open it with Database.open, or grow the one that it was "
            "refined from, and refine that one again"
        )
    different = sorted(name for name in {*settings, *record} if settings.get(name) != record.get(name))
    if different:
        told = ", ".join(f"{name} {settings.get(name)!r} (given: {record.get(name)!r})" for name in different)
        return (
            f"was made with other parameters, settings or seed: {told}; give these, remove it, or choose another path"
        )
    if len(known) > len(p) and np.array_equal(known[: len(p)], p):
        return (
            f"holds {len(known)} instances, of which the given {len(p)} are the first; pass all of them, or "
            f"open it and select, as in Database.open(path).samples(range({len(p)}))"
        )
    if not np.array_equal(known, p[: len(known)]):
        return (
            f"was made with other parameters, settings or seed: its {len(known)} parameters are not the first of the "
            f"given {len(p)}. A database grows where the parameters begin with those that it was made with, in the "
            "same order, as those of ocp_envs.sample do with one seed; give these, or choose another path"
        )
    return ""
