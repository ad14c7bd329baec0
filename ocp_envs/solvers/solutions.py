"""Solutions of batches of problems: physical units, independently checked, failures as values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.nlp import Result, Status, Task
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Array
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Solutions(Batch):
    """How B solves ended.

    Args:
        trajectory: B trajectories, NaN where not solved.
        cost: (B,), +inf where not solved.
        multipliers: of the path constraint at the knots, (B, N, nh), ≥ 0, in units of cost per unit of clearance; NaN
            where not solved.
        status: (B,) int8, values of :class:`Status`.
        iterations: (B,) int32, of both solvers together.
        fallback: (B,) bool, whether the second solver was used.
        seconds: (B,) time of the solve.
    """

    trajectory: Trajectory
    cost: Array
    multipliers: Array
    status: NDArray[np.int8]
    iterations: NDArray[np.int32]
    fallback: NDArray[np.bool_]
    seconds: Array

    @property
    def solved(self) -> NDArray[np.bool_]:
        return self.status == Status.SOLVED

    def _blank(self, rows: NDArray[np.bool_]) -> None:
        """Remove the solutions of ``rows``; only before anybody else sees these arrays."""
        for values in (self.trajectory.states, self.trajectory.controls, self.trajectory.duration, self.multipliers):
            values[rows] = np.nan
        self.cost[rows] = np.inf


def make_tasks(
    problem: OptimalControlProblem,
    transcription: Transcription,
    parameters: Array,
    guesses: Trajectory,
    windings: NDArray[np.integer],
    retry_with_fallback: bool = True,
) -> list[Task]:
    """The solves of a batch, validated and in scaled variables."""
    windings = np.asarray(windings)
    expected = (len(parameters), problem.knots, problem.system.nx)
    if guesses.states.shape != expected or windings.shape != expected[:1]:
        raise ValueError(
            f"{problem.id}: expected guesses with states {expected} and windings {expected[:1]} for "
            f"{len(parameters)} parameters; got {guesses.states.shape} and {windings.shape}"
        )
    if not guesses.finite.all():
        raise ValueError(f"{problem.id}: guess {int(np.flatnonzero(~guesses.finite)[0])} is not finite")
    count = len(problem.targets)
    if np.any((windings < -1) | (windings >= count)):
        raise ValueError(f"{problem.id}: windings must be -1 … {count - 1}, got {windings.min()} … {windings.max()}")
    distance = np.abs((guesses.states[:, -1, None] - problem.targets) / problem.system.state.scale).sum(axis=2)
    targets = np.where(windings < 0, distance.argmin(axis=1), windings)
    fixed = np.concatenate(problem.start(parameters), axis=1)
    return [Task(*row, retry_with_fallback) for row in zip(transcription.pack(guesses), fixed, targets.tolist())]


def collect(
    problem: OptimalControlProblem, transcription: Transcription, parameters: Array, results: Iterable[Result]
) -> Solutions:
    """Results in physical units, each checked independently of the solver."""
    size, control = len(parameters), problem.system.control
    statuses, w, costs, held, iterations, fallback, seconds = zip(*results) if size else ([],) * 7
    status, cost = np.array(statuses, dtype=np.int8), np.array(costs, dtype=np.float64)
    starts, _ = problem.start(parameters)
    trajectory = transcription.unpack(np.array(w).reshape(size, len(transcription.lower)), starts)
    np.clip(trajectory.controls, control.lower, control.upper, out=trajectory.controls)  # IPOPT relaxes bounds by 1e-8
    multipliers = np.zeros((size, problem.knots, problem.n_clearances))  # none at the first knot, which is given
    multipliers[:, 1:] = np.array(held).reshape(multipliers[:, 1:].shape)
    check = verify(problem, parameters, trajectory, cost)
    status[(status == Status.SOLVED) & ~check.passed] = Status.CHECK_FAILED
    solutions = Solutions(
        trajectory=trajectory,
        cost=cost,
        multipliers=multipliers,
        status=status,
        iterations=np.array(iterations, dtype=np.int32),
        fallback=np.array(fallback, dtype=bool),
        seconds=np.array(seconds, dtype=np.float64),
    )
    solutions._blank(~solutions.solved)
    return solutions


def best_per_mode(problem: OptimalControlProblem, parameters: Array, solutions: Solutions) -> Solutions:
    """The cheapest of several solutions of one parameter (np,) in each mode: one row per mode, EMPTY where none is."""
    found = np.flatnonzero(solutions.solved)
    modes = np.full(len(solutions), -1)
    if len(found):
        p = np.repeat(parameters[None], len(found), axis=0)
        modes[found] = problem.modes.classify(problem, p, solutions.trajectory[found], solutions.multipliers[found])
    # A stable order: of equal costs the earlier solve wins.
    order = np.argsort(solutions.cost, kind="stable")
    rows = [next((i for i in order if modes[i] == mode), -1) for mode in range(len(problem.modes))]
    return _with_empty(solutions, np.array(rows))


def _with_empty(solutions: Solutions, rows: NDArray[np.int64]) -> Solutions:
    """The given rows; where a row is −1, an EMPTY one."""
    chosen = solutions[rows]
    empty = rows < 0
    chosen._blank(empty)
    chosen.status[empty] = Status.EMPTY
    chosen.iterations[empty], chosen.fallback[empty], chosen.seconds[empty] = 0, False, 0.0
    return chosen
