"""Solving batches of problems, and the best known optimum of one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ocp_envs.check import Check, verify
from ocp_envs.guesses import guesses
from ocp_envs.nlp import NlpSolver, Result, SolverSettings, Status, Task
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Array
from ocp_envs.trajectory import Trajectory
from ocp_envs.transcription import Transcription, transcribe

__all__ = ["Check", "Solutions", "Solver", "SolverSettings", "Status", "guesses", "verify"]


@dataclass(frozen=True, eq=False)
class Solutions:
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

    def __len__(self) -> int:
        return len(self.cost)

    @property
    def solved(self) -> NDArray[np.bool_]:
        return self.status == Status.SOLVED


class Solver:
    """Solves problems in this process; a solver that hangs hangs it (see :class:`GuardedSolver`)."""

    def __init__(self, problem: OptimalControlProblem, settings: SolverSettings = SolverSettings()) -> None:
        self.problem, self.settings = problem, settings
        self._transcription = transcribe(problem)
        self._nlp = NlpSolver(self._transcription, settings)

    def solve(self, parameters: Array, guesses: Trajectory, windings: NDArray[np.integer]) -> Solutions:
        """Solve B problems, each from one guess.

        Args:
            parameters: (B, np).
            guesses: B trajectories.
            windings: (B,) indices into ``problem.targets``; −1 takes the target nearest to the guess's end.

        Raises:
            ValueError: shapes or windings that do not fit, guesses that are not finite.
        """
        tasks = make_tasks(self.problem, self._transcription, parameters, guesses, windings)
        results = [self._nlp.solve(task) for task in tasks]
        return collect(self.problem, self._transcription, parameters, results)


def make_tasks(
    problem: OptimalControlProblem,
    transcription: Transcription,
    parameters: Array,
    guesses: Trajectory,
    windings: NDArray[np.integer],
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
    if len(windings) and not (-1 <= windings.min() and windings.max() < count):
        raise ValueError(f"{problem.id}: windings must be -1 … {count - 1}, got {windings.min()} … {windings.max()}")
    distance = np.abs((guesses.states[:, -1, None] - problem.targets) / problem.system.state.scale).sum(axis=2)
    targets = np.where(windings < 0, distance.argmin(axis=1), windings)
    fixed = np.concatenate(problem.start(parameters), axis=1)
    return [Task(*row) for row in zip(transcription.pack(guesses), fixed, targets.tolist())]


def collect(
    problem: OptimalControlProblem, transcription: Transcription, parameters: Array, results: Iterable[Result]
) -> Solutions:
    """Results in physical units, each checked independently of the solver."""
    statuses, w, cost, lam_g, iterations, fallback, seconds = zip(*results) if parameters.size else ([],) * 7
    status = np.array(statuses, dtype=np.int8)
    starts, _ = problem.start(parameters)
    trajectory = transcription.unpack(np.array(w).reshape(len(starts), -1), starts)
    np.clip(trajectory.controls, problem.system.control.lower, problem.system.control.upper, out=trajectory.controls)
    multipliers = transcription.clearance_multipliers(np.array(lam_g).reshape(len(starts), -1))
    check = verify(problem, parameters, trajectory, np.array(cost))
    status[(status == Status.SOLVED) & ~check.passed] = Status.CHECK_FAILED
    failed = status != Status.SOLVED
    for values in (trajectory.states, trajectory.controls, trajectory.duration, multipliers):
        values[failed] = np.nan
    return Solutions(
        trajectory=trajectory,
        cost=np.where(failed, np.inf, np.array(cost)),
        multipliers=multipliers,
        status=status,
        iterations=np.array(iterations, dtype=np.int32),
        fallback=np.array(fallback, dtype=bool),
        seconds=np.array(seconds, dtype=np.float64),
    )
