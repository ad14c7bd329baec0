"""Refined databases: every instance is solved again from the plans of a planner, and the better optimum is kept.

A planner that has learnt from a database knows solution families which the search for single instances has missed:
what it plans for one instance comes from its neighbours. Where the solver, starting from that plan, ends at a lower
cost, the database was not optimal.

The database that is refined stays as it is. The refined one is written chunk by chunk, so a process may be killed at
any moment; the same call continues.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import cloudpickle
import numpy as np

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError, StoredRows
from ocp_envs.data.locks import only_writer
from ocp_envs.data.refined import Refinement, better, cheaper
from ocp_envs.data.worker import best_rows, kept_solver, start_from
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING, guesses_of
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import OF_MANY_GUESSES, GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.support.progress import Progress
from ocp_envs.support.tasks import TaskRun, workers_of
from ocp_envs.trajectory import Trajectory

#: What a record of a refined database calls how it was refined.
REFINED = "refined"
#: Makes one plan for each of B instances with parameters (B, np), or several.
Plans = Callable[[Array], Trajectory | Sequence[Trajectory]]


@dataclass(frozen=True, eq=False)
class _Task:
    """The chunk ``number`` of the pickled ``problem``: ``parameters`` (B, np), and batches of B ``plans``.

    It is solved with ``settings``.
    """

    number: int
    problem: bytes
    settings: SolverSettings
    parameters: Array
    plans: Sequence[Trajectory]


@checked
def refine(
    database: Database,
    planner: Plans,
    path: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: bool | None = None,
) -> Refinement:
    """Solve all instances of a database again from a planner's plans, and store the better optimum of every family.

    The same call continues where an earlier one was interrupted. What it stores depends on the database and the plans
    alone. With the default executor the calling script needs Python's usual ``if __name__ == "__main__":``.

    Args:
        database: a finished database, which stays as it is.
        planner: makes the plans: a planner, of a mixture the plans of all experts (the planner's method
            ``alternatives``, where it has one), or any function from parameters (B, np) to B trajectories or a sequence
            of such. A plan that is not finite is left out.
        path: folder of the refined database.
        executor: any ``concurrent.futures`` executor; by default a pool of processes.
        workers: processes of the default pool, or tasks that ``executor`` runs at once; one per core where not given.
        progress: show it, as :func:`ocp_envs.generate` does.

    Returns:
        the refined database, and by how much which instances have become cheaper.

    Raises:
        DatabaseError: a database that is not finished, or a path with something else than what this call began.
        TypeError: a planner that returns something else than trajectories.
        ValueError: plans of another problem.
    """
    folder, problem = Path(path), database.problem
    if not database.complete:
        raise DatabaseError(f"{database.path} is not finished; generate it first")
    plans = _plans_of(problem, planner)
    with only_writer(folder):
        refined = _open_or_create(folder, database, planner, plans)
        missing = np.flatnonzero(~refined.present()).tolist()
        if missing:
            _finish(database, refined, plans, missing, executor, workers, progress)
    return Refinement(refined, database.costs(), refined.costs())


def _plans_of(problem: OptimalControlProblem, planner: Plans) -> Callable[[Array], list[Trajectory]]:
    """The plans of ``planner`` for parameters of ``problem``, checked; of several kinds where it has alternatives."""
    own = getattr(planner, "problem", None)
    if isinstance(own, OptimalControlProblem) and own.id != problem.id:
        raise ValueError(f"the planner belongs to {own.id}, not to {problem.id}")
    plan: Plans = getattr(planner, "alternatives", planner)
    return lambda p: guesses_of(problem, p, plan, "planner")


def _open_or_create(
    folder: Path, database: Database, planner: Plans, plans: Callable[[Array], list[Trajectory]]
) -> Database:
    """The database in ``folder`` that ``database`` is refined to; a new one where there is none."""
    sha = hashlib.sha256()
    for plan in plans(database.stored_parameters(database.stored_rows(0))):
        sha.update(plan.flat().astype(np.float32).tobytes())
    step = {"from": database.key, "planner": str(getattr(planner, "name", "")), "plans": sha.hexdigest()}
    settings = {**database.settings, REFINED: [*_steps(database), step]}
    if not folder.exists():
        Database.create(
            folder,
            database.problem,
            database.parameters,
            order=database.order,
            settings=settings,
            chunk=database.chunk,
        )
    refined = Database.open(folder, database.problem)
    if refined.settings != settings:
        raise DatabaseError(
            f"{folder} holds a database that was not refined from {database.path} with these plans; remove it, or "
            "choose another path"
        )
    return refined


def _steps(database: Database) -> list[object]:
    """How ``database`` was refined so far."""
    known = database.settings.get(REFINED, [])
    return list(known) if isinstance(known, list) else []


def _finish(
    database: Database,
    refined: Database,
    plans: Callable[[Array], list[Trajectory]],
    missing: Sequence[int],
    executor: Executor | None,
    workers: int | None,
    progress: bool | None,
) -> None:
    """Solve the chunks ``missing`` of ``refined`` again, and write them as they arrive."""
    problem = database.problem
    with GuardedSolver(problem, OF_MANY_GUESSES) as solver:
        solver.start()  # compiles, once, before workers ask for it
    done = refined.totals()["problems"]
    bar = Progress(len(database), unit="instance", label=f"{problem.id}, refine", initial=done, shown=progress)
    improved = 0

    def write(task: _Task, found: StoredRows) -> None:
        nonlocal improved
        stored = database.stored(database.stored_rows(task.number))
        rows = better(stored, found)
        refined.write(task.number, rows)
        improved += int(cheaper(stored.cost.min(axis=1), rows.cost.min(axis=1)).sum())
        bar.update(len(rows), improved=improved)

    with bar, workers_of(executor, workers) as pool:
        TaskRun(refine_chunk, pool, write)(_tasks(database, plans, missing))


def _tasks(database: Database, plans: Callable[[Array], list[Trajectory]], missing: Sequence[int]) -> Iterator[_Task]:
    payload = cloudpickle.dumps(database.problem)
    for number in missing:
        p = database.stored_parameters(database.stored_rows(number))
        yield _Task(number, payload, OF_MANY_GUESSES, p, plans(p))


def refine_chunk(task: _Task) -> StoredRows:
    """What the solver finds from the plans of ``task``, in a process that keeps a solver child for each thread."""
    solver = kept_solver(task.problem, task.settings)
    problem, count = solver.problem, len(task.parameters)
    owner = np.tile(np.arange(count), len(task.plans))
    guess = Trajectory.concatenate(task.plans)
    tried = guess.finite & ~np.isin(owner, list(infeasible_rows(problem, task.parameters)))
    owner, guess = owner[tried], guess[tried]
    p = task.parameters[owner]
    begun = start_from(problem, p, guess.flat())
    nearest = np.full(len(p), NEAREST_WINDING)
    return best_rows(problem, task.parameters, owner, solver.solve(p, begun, nearest, retry_with_fallback=False))
