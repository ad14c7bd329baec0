"""How a worker solves a chunk of problem instances: warm starts first, then random guesses to every winding.

Where the primary solver does not converge from a guess, another guess is usually cheaper than the fallback solver. Only
an instance that no guess solves is retried with the fallback.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from ocp_envs.data.layout import StoredRows
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING, GuessKind, guesses
from ocp_envs.solvers.nlp import SolverSettings, Status
from ocp_envs.solvers.solutions import Solutions, best_per_mode
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.trajectory import Trajectory

#: A winding that failed from this many guesses is given up: most such goals are out of reach in the time allowed.
PATIENCE = 2


@dataclass(frozen=True, eq=False)
class Chunk:
    """A task: the chunk ``number`` of a database, B instances of ``problem`` (pickled) with ``parameters`` (B, np).

    They are solved with ``settings``, from W warm starts ``z`` (W, flat_size) in the flat layout, which belong to the
    instances ``owner`` (W,), and from ``cold`` (B,) random guesses for every winding, which ``seed`` determines.
    """

    number: int
    problem: bytes
    settings: GenerationSettings
    seed: tuple[int, ...]
    parameters: Array
    owner: Ints
    z: NDArray[np.float32]
    cold: Ints


#: Which instance of the chunk each solve belongs to, and how the solves ended.
_Solves = tuple[Ints, Solutions]
#: What each thread that solves keeps from task to task.
KEPT = threading.local()


def kept_solver(payload: bytes, settings: SolverSettings) -> GuardedSolver:
    """This thread's solver of the pickled problem ``payload`` with ``settings``; it replaces one for anything else."""
    # By process: a forked process must neither talk to its parent's child nor end it.
    solvers: dict[int, tuple[tuple[bytes, SolverSettings], GuardedSolver]]
    solvers = KEPT.__dict__.setdefault("solvers", {})
    key, solver = solvers.get(os.getpid(), (None, None))
    if solver is None or key != (payload, settings):
        if solver is not None:
            solver.close()
        solver = GuardedSolver(cloudpickle.loads(payload), settings)
        solvers[os.getpid()] = (payload, settings), solver
    return solver


def solve_chunk(chunk: Chunk) -> StoredRows:
    """Solve all instances of ``chunk``, in a process that keeps one solver child for each thread that solves."""
    solver = kept_solver(chunk.problem, chunk.settings.solver)
    problem = solver.problem
    hopeless = np.array(sorted(infeasible_rows(problem, chunk.parameters)), dtype=np.int64)
    chunk = _without(chunk, hopeless)
    solves: list[_Solves] = []
    if len(chunk.owner):
        p = chunk.parameters[chunk.owner]
        windings = np.full(len(p), NEAREST_WINDING)
        solves.append((chunk.owner, solver.solve(p, start_from(problem, p, chunk.z), windings)))
    solves += multistart(solver, chunk)
    solved = np.concatenate([np.empty(0, np.int64), *[owner[found.solved] for owner, found in solves]])
    done = np.concatenate([solved, hopeless])
    last = _last_resort(solver, chunk, np.setdiff1d(np.arange(len(chunk.parameters)), done))
    solves.append(last)
    owners, solutions = zip(*solves)
    rows = best_rows(problem, chunk.parameters, np.concatenate(owners), Solutions.concatenate(solutions))
    rows.status[[*hopeless, *_all_infeasible(*last)]] = Status.INFEASIBLE
    return rows


def _all_infeasible(owner: Ints, solutions: Solutions) -> Ints:
    """The instances of which the fallback solver found every winding infeasible, given the ``owner`` of each solve."""
    others = owner[solutions.status != Status.INFEASIBLE]
    return np.setdiff1d(owner, others)


def _without(chunk: Chunk, rows: Ints) -> Chunk:
    """``chunk`` without solves of the instances ``rows``."""
    wanted = ~np.isin(chunk.owner, rows)
    cold = np.where(np.isin(np.arange(len(chunk.cold)), rows), 0, chunk.cold)
    return replace(chunk, owner=chunk.owner[wanted], z=chunk.z[wanted], cold=cold)


def start_from(problem: OptimalControlProblem, parameters: Array, z: NDArray[np.floating]) -> Trajectory:
    """Guesses for instances of ``problem`` with ``parameters`` (B, np), from their initial states.

    They are made of trajectories ``z`` (B, flat_size) of other instances, or of fits through these, clipped to the
    boxes of states, controls and duration.
    """
    guess, state, control = problem.unflatten(z), problem.planned_states, problem.planned_controls
    states = np.clip(guess.states, state.lower, state.upper)
    states[:, 0], contexts = problem.start(parameters)
    controls = np.clip(guess.controls, control.lower, control.upper)
    return Trajectory(states, controls, np.clip(guess.duration, *problem.horizon.of(contexts).T))


def _every_winding(problem: OptimalControlProblem, rows: Ints) -> tuple[Ints, Ints]:
    """Row and winding of a solve of each of ``rows`` to each winding of the goal."""
    count = len(problem.terminal)
    return np.repeat(rows, count), np.tile(np.arange(count), len(rows))


def multistart(solver: GuardedSolver, chunk: Chunk) -> Iterator[_Solves]:
    """Solves of ``chunk`` by ``solver`` from random guesses; windings that keep failing are given up.

    Yields the instance of each solve (S,) and S solutions, for one guess after the other.
    """
    problem = solver.problem
    owner, windings = _every_winding(problem, np.arange(len(chunk.parameters)))
    reached = np.zeros(len(owner), dtype=bool)
    rng = np.random.default_rng(chunk.seed)
    for attempt in range(chunk.cold.max(initial=0)):
        kind: GuessKind = "line" if attempt == 0 else chunk.settings.guess
        # Drawn for all, so that a guess does not depend on how other instances ended.
        guess = guesses(problem, chunk.parameters[owner], windings, rng, kind)
        tried = np.flatnonzero((reached | (attempt < PATIENCE)) & (attempt < chunk.cold[owner]))
        if not len(tried):
            return
        p = chunk.parameters[owner[tried]]
        found = solver.solve(p, guess[tried], windings[tried], retry_with_fallback=False)
        reached[tried] |= found.solved
        yield owner[tried], found


def _last_resort(solver: GuardedSolver, chunk: Chunk, rows: Ints) -> _Solves:
    """Solves of ``rows``, which have no solution: from a line to every winding, retried with the fallback solver."""
    owner, windings = _every_winding(solver.problem, rows)
    line = guesses(solver.problem, chunk.parameters[owner], windings, np.random.default_rng(chunk.seed), "line")
    return owner, solver.solve(chunk.parameters[owner], line, windings, retry_with_fallback=True)


def best_rows(problem: OptimalControlProblem, parameters: Array, owner: Ints, solutions: Solutions) -> StoredRows:
    """What is stored of the instances of ``problem`` with ``parameters`` (B, np), given S ``solutions`` of theirs.

    Each belongs to the instance ``owner`` (S,).
    """
    size = len(parameters)
    order = np.argsort(owner, kind="stable")
    groups = np.split(order, np.searchsorted(owner[order], np.arange(1, size)))
    slots = Solutions.concatenate([best_per_mode(problem, p, solutions[each]) for p, each in zip(parameters, groups)])
    shape = (size, len(problem.modes))
    solved = slots.solved.reshape(shape).any(axis=1)
    # A row without any solution ended as its first solve did.
    first = np.array([solutions.status[each[0]] if len(each) else Status.EMPTY for each in groups], dtype=np.int8)

    def total(values: NDArray[np.generic]) -> NDArray[np.int32]:
        return np.bincount(owner, values.astype(np.float64), size).astype(np.int32)

    return StoredRows(
        status=np.where(solved, np.int8(Status.SOLVED), first),
        slot_status=slots.status.reshape(shape),
        cost=slots.cost.reshape(shape),
        z=slots.trajectory.flat().reshape(*shape, problem.flat_size),
        multipliers=slots.multipliers.reshape(*shape, problem.knots, problem.n_clearances),
        solves=total(np.ones(len(owner))),
        failures=total(~solutions.solved),
        fallbacks=total(solutions.fallback),
        iterations=total(solutions.iterations),
    )
