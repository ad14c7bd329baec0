"""Solutions of batches of problem instances: physical units, independently checked, failures as values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.nlp import Result, Status, Task
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: Rows of one batch.
_MOST = 10**6


@checked
@dataclass(frozen=True, eq=False)
class Solutions(Batch):
    """How B solves ended: ``status``, values of :class:`Status`, and what was found.

    This is ``trajectory``, B trajectories, their ``cost`` (B,) and the ``multipliers`` (B, N, nh) of the path
    constraint at the knots, ≥ 0, in units of cost per unit of clearance. Where not solved, the cost is +inf and the
    rest NaN. A solve took ``seconds`` and ``iterations`` of both solvers together, and perhaps the ``fallback`` solver.
    """

    trajectory: Trajectory
    cost: Array
    multipliers: Array
    status: NDArray[np.int8]
    iterations: NDArray[np.int32]
    fallback: Bools
    seconds: Array

    @classmethod
    @checked
    def empty(cls, problem: ProblemOrId, count: int) -> Solutions:
        """``count`` times the outcome of no solve at all of ``problem``: EMPTY, without a trajectory."""
        problem = problem_of(problem)
        check_whole("count", count, 0, _MOST)
        return cls(
            trajectory=problem.unflatten(np.full((count, problem.flat_size), np.nan)),
            cost=np.full(count, np.inf),
            multipliers=np.full((count, problem.knots, problem.n_clearances), np.nan),
            status=np.full(count, Status.EMPTY, dtype=np.int8),
            iterations=np.zeros(count, dtype=np.int32),
            fallback=np.zeros(count, dtype=bool),
            seconds=np.zeros(count),
        )

    @property
    def solved(self) -> Bools:
        """Which solves found a trajectory that passed the check, (B,)."""
        return self.status == Status.SOLVED


def make_tasks(
    problem: OptimalControlProblem,
    transcription: Transcription,
    parameters: Array,
    guesses: Trajectory,
    windings: NDArray[np.integer],
    retry_with_fallback: bool = True,
    rescue: bool = True,
    iterations: int | None = None,
    margins: Array | None = None,
) -> list[Task]:
    """The solves of instances of ``problem`` with ``parameters`` (B, np) in scaled variables of ``transcription``.

    The other arguments, ``guesses``, ``windings``, ``retry_with_fallback``, ``rescue``, ``iterations`` and ``margins``,
    are those of :meth:`~ocp_envs.solvers.solver.GuardedSolver.attempts`.

    Raises:
        ValueError: shapes or windings that do not fit.
    """
    windings = np.asarray(windings)
    expected = (len(parameters), problem.knots, problem.system.nx)
    if guesses.states.shape != expected or windings.shape != expected[:1]:
        raise ValueError(
            f"{problem.id}: expected guesses with states {expected} and windings {expected[:1]} for "
            f"{len(parameters)} parameters; got {guesses.states.shape} and {windings.shape}"
        )
    count, fixed = len(problem.terminal), problem.start(parameters)
    if np.any((windings < NEAREST_WINDING) | (windings >= count)):
        raise ValueError(
            f"{problem.id}: windings must be {NEAREST_WINDING} … {count - 1}, got {windings.min()} … {windings.max()}"
        )
    ends = guesses.states[:, -1]
    nearest = problem.terminal.nearest(ends, fixed[1])
    distance = np.abs((ends[:, None] - nearest) / problem.system.state.scale).sum(axis=2)
    targets = np.where(windings == NEAREST_WINDING, distance.argmin(axis=1), windings)
    kept = [None] * len(parameters) if margins is None else margins
    instances = zip(transcription.pack(guesses), np.concatenate(fixed, axis=1), targets.tolist(), kept, strict=True)
    return [
        Task(guess, parameter, target, retry_with_fallback, rescue, iterations, margin)
        for guess, parameter, target, margin in instances
    ]


def collect(
    problem: OptimalControlProblem, transcription: Transcription, parameters: Array, results: Iterable[Result]
) -> Solutions:
    """Solutions in physical units, each checked independently of the solver, from the B ``results`` of its solves.

    The instances of ``problem``, whose program is ``transcription``, have ``parameters`` (B, np).
    """
    size, control = len(parameters), problem.planned_controls
    statuses, w, costs, held, iterations, fallback, seconds = zip(*results) if size else ([],) * 7
    initial, _ = problem.start(parameters)
    found = transcription.unpack(np.array(w).reshape(size, len(transcription.lower)), initial)
    controls = np.clip(found.controls, control.lower, control.upper)  # IPOPT relaxes bounds by 1e-8
    trajectory = Trajectory(found.states, controls, found.duration)
    multipliers = np.zeros((size, problem.knots, problem.n_clearances))  # none at the first knot, which is given
    multipliers[:, 1:] = np.array(held).reshape(multipliers[:, 1:].shape)
    status, cost = np.array(statuses, dtype=np.int8), np.array(costs, dtype=np.float64)
    passed = verify(problem, parameters, trajectory, cost).passed
    status[(status == Status.SOLVED) & ~passed] = Status.CHECK_FAILED
    failed = status != Status.SOLVED
    nothing = Solutions.empty(problem, int(failed.sum()))
    return Solutions(
        trajectory=trajectory.replaced(failed, nothing.trajectory),
        cost=np.where(failed, np.inf, cost),
        multipliers=np.where(failed[:, None, None], np.nan, multipliers),
        status=status,
        iterations=np.array(iterations, dtype=np.int32),
        fallback=np.array(fallback, dtype=bool),
        seconds=np.array(seconds, dtype=np.float64),
    )


def best_per_mode(problem: OptimalControlProblem, parameters: Array, solutions: Solutions) -> Solutions:
    """The cheapest of the ``solutions`` of one instance in each solution family of ``problem``; EMPTY without any.

    The instance has ``parameters`` (np,).
    """
    found = np.flatnonzero(solutions.solved)
    found = found[np.argsort(solutions.cost[found], kind="stable")]  # of equal costs the earlier solve wins
    best = Solutions.empty(problem, len(problem.modes))
    if not len(found):
        return best
    p = np.repeat(parameters[None], len(found), axis=0)
    mode = problem.modes.of(problem, p, solutions.trajectory[found], solutions.multipliers[found])
    which, first = np.unique(mode, return_index=True)
    return best.replaced(np.isin(np.arange(len(best)), which), solutions[found[first]])
