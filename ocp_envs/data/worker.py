"""Chunks of problems, and how a worker solves one: warm starts first, then random guesses to every winding.

Where the first solver does not get on from a guess, another guess is mostly better than the second solver. A problem
that none of them solves gets it in the end.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from ocp_envs.data.database import Rows
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING, GuessKind, guesses
from ocp_envs.solvers.nlp import SolverSettings, Status
from ocp_envs.solvers.solutions import Solutions, best_per_mode
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: A winding that failed from so many guesses is given up: most such goals are out of reach in the time allowed.
PATIENCE = 2


@dataclass(frozen=True, eq=False)
class Chunk:
    """A chunk of problems.

    Args:
        number: which chunk of the database it is.
        problem: the problem, pickled by value.
        settings: how.
        seed: of the chunk's random guesses.
        parameters: (B, np).
        owner, z: row and flat guess of every warm start.
        cold: random guesses for every winding, by row, (B,).
    """

    number: int
    problem: bytes
    settings: GenerationSettings
    seed: tuple[int, ...]
    parameters: Array
    owner: NDArray[np.int64]
    z: NDArray[np.float32]
    cold: NDArray[np.int64]


#: What each thread that solves keeps from task to task.
_kept = threading.local()


def _worker(payload: bytes, settings: SolverSettings) -> tuple[OptimalControlProblem, GuardedSolver]:
    """The problem and this thread's solver child; one for another problem or other settings ends the one before."""
    # By process: a forked process must neither talk to its parent's child nor end it.
    kept: dict[int, tuple[tuple[bytes, SolverSettings], GuardedSolver]]
    kept = _kept.__dict__.setdefault("solvers", {})
    key, solver = kept.get(os.getpid(), (None, None))
    if solver is None or key != (payload, settings):
        if solver is not None:
            solver.close()
        solver = GuardedSolver(cloudpickle.loads(payload), settings)
        kept[os.getpid()] = (payload, settings), solver
    return solver.problem, solver


def solve_chunk(task: Chunk) -> Rows:
    """Solve all problems of ``task``, in a process that keeps one solver child for each thread that solves."""
    problem, solver = _worker(task.problem, task.settings.solver)
    owner, solutions = [], []
    if len(task.owner):
        guess = start_from(problem, task.parameters[task.owner], task.z)
        solutions.append(solver.solve(task.parameters[task.owner], guess, np.full(len(task.owner), NEAREST_WINDING)))
        owner.append(task.owner)
    for rows, found in _multistart(problem, solver, task):
        owner.append(rows)
        solutions.append(found)
    solved = np.concatenate([rows[found.solved] for rows, found in zip(owner, solutions)])
    rows, found = _last_resort(problem, solver, task, np.setdiff1d(np.arange(len(task.parameters)), solved))
    owner.append(rows)
    solutions.append(found)
    return _rows(problem, task.parameters, np.concatenate(owner), Solutions.concatenate(solutions))


def start_from(problem: OptimalControlProblem, parameters: Array, z: NDArray[np.float32]) -> Trajectory:
    """Neighbours' solutions, or a fit through them, as guesses in the boxes; the first state is the problem's own."""
    guess = problem.unflatten(z)
    boxes = problem.system.state, problem.system.control
    states, controls = (np.clip(a, b.lower, b.upper) for a, b in zip((guess.states, guess.controls), boxes))
    states[:, 0] = problem.start(parameters)[0]
    return Trajectory(states, controls, np.clip(guess.duration, *problem.duration))


def _multistart(
    problem: OptimalControlProblem, solver: GuardedSolver, task: Chunk
) -> Iterator[tuple[NDArray[np.int64], Solutions]]:
    """Row and solution of every random guess; windings that keep failing are given up."""
    targets = len(problem.targets)
    rows = np.repeat(np.arange(len(task.parameters)), targets)
    windings = np.tile(np.arange(targets), len(task.parameters))
    reached = np.zeros(len(rows), dtype=bool)
    rng = np.random.default_rng(task.seed)
    for attempt in range(task.cold.max(initial=0)):
        kind: GuessKind = "line" if attempt == 0 else task.settings.guess
        guess = guesses(problem, task.parameters[rows], windings, rng, kind)
        open_ = np.flatnonzero((reached | (attempt < PATIENCE)) & (attempt < task.cold[rows]))
        if not len(open_):
            return
        found = solver.solve(task.parameters[rows[open_]], guess[open_], windings[open_], retry_with_fallback=False)
        reached[open_] |= found.solved
        yield rows[open_], found


def _last_resort(
    problem: OptimalControlProblem, solver: GuardedSolver, task: Chunk, rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Solutions]:
    """Rows without any solution: from a line to every winding, with the second solver where the first is stuck."""
    targets = len(problem.targets)
    owner, windings = np.repeat(rows, targets), np.tile(np.arange(targets), len(rows))
    line = guesses(problem, task.parameters[owner], windings, np.random.default_rng(task.seed), "line")
    return owner, solver.solve(task.parameters[owner], line, windings, retry_with_fallback=True)


def _rows(problem: OptimalControlProblem, parameters: Array, owner: NDArray[np.int64], solutions: Solutions) -> Rows:
    """What the solves of a chunk give its rows."""
    size = len(parameters)
    order = np.argsort(owner, kind="stable")
    groups = np.split(order, np.searchsorted(owner[order], np.arange(1, size)))
    best = [best_per_mode(problem, p, solutions[group]) for p, group in zip(parameters, groups)]
    slots = Solutions.concatenate(best)
    shape = (size, len(problem.modes))
    failed = ~solutions.solved
    solved = slots.solved.reshape(shape).any(axis=1)
    # A row without any solution ended as its first solve did.
    first = np.array([solutions.status[group[0]] if len(group) else Status.EMPTY for group in groups], dtype=np.int8)

    def count(weights: NDArray[Any]) -> NDArray[np.int32]:
        return np.bincount(owner, weights, size).astype(np.int32)

    return Rows(
        status=np.where(solved, np.int8(Status.SOLVED), first),
        slot_status=slots.status.reshape(shape),
        cost=np.where(slots.solved, slots.cost, np.inf).reshape(shape),
        z=slots.trajectory.flat().reshape(*shape, problem.flat_size),
        multipliers=slots.multipliers.reshape(*shape, problem.knots, problem.n_clearances),
        solves=count(np.ones(len(owner))),
        failures=count(failed),
        fallbacks=count(solutions.fallback),
        iterations=count(solutions.iterations),
    )
