"""The best known optimum of one instance: solves from given guesses and from those of a multistart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.failure import Failure, explained, of_instance
from ocp_envs.solvers.guesses import NEAREST_WINDING, Guess, GuessKind, bends_of, guesses, guesses_of, random_kind
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.solutions import Solutions, best_per_mode
from ocp_envs.solvers.solver import Attempts, GuardedSolver, lent_solvers
from ocp_envs.support.arrays import Array
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: Guesses of one solve for each winding, where none are given.
STARTS = 6
_MOST_STARTS = 1000


@checked
@dataclass(frozen=True, eq=False)
class Solution:
    """The best known optimum of the instance with ``parameters`` (np,), and the best trajectory of every family.

    Trajectories begin in the turn in which the angles of ``parameters`` are written. Families are those of the same
    instance in the turn around the centre of the parameter box: their windings count from there. In ``modes`` each
    solution family of the problem has a row, EMPTY where no trajectory was found. The ``status`` is SOLVED where any
    family was found, otherwise how the last solve from a line failed; then the ``reason`` says in a sentence which
    constraint is violated, at which knot and by how much, or which function is not finite. The ``failure`` says it in
    parts: the phase, the least infeasible point, and what to try.
    """

    parameters: Array
    modes: Solutions
    status: Status
    reason: str = ""
    failure: Failure | None = None

    def __repr__(self) -> str:
        found = f"cost {self.cost:.6g}, mode {self.mode}" if self.mode is not None else "no trajectory"
        parameters = np.array2string(self.parameters, precision=4, separator=", ")
        return f"<Solution of {parameters}: {self.status.name}, {found}, of {len(self.modes)} solution families>"

    @property
    def mode(self) -> int | None:
        """The solution family of the best optimum; ``None`` where nothing was found."""
        return int(self.modes.cost.argmin()) if self.status == Status.SOLVED else None

    @property
    def cost(self) -> float:
        """The lowest cost found; +inf where nothing was found."""
        return float(self.modes.cost.min())

    @property
    def trajectory(self) -> Trajectory:
        """The best trajectory, a batch of one; NaN where nothing was found."""
        return self.modes.trajectory[self.mode or 0]


@dataclass(frozen=True)
class Multistart:
    """Guesses in addition to those that are given: ``starts`` for each winding; ``seed`` determines the random ones.

    One of them is a straight line, the others are random.
    """

    starts: int
    seed: int

    @classmethod
    def of(cls, starts: int | None, seed: int, given: bool) -> Multistart:
        """With ``starts``, by default none where guesses are ``given``, and :data:`STARTS` elsewhere, and a ``seed``.

        Raises:
            ValueError: starts out of their range.
        """
        default = 0 if given else STARTS
        check_whole("starts", default if starts is None else starts, 0 if given else 1, _MOST_STARTS)
        return cls(default if starts is None else starts, seed)


@checked
def solve(
    problem: ProblemOrId,
    p: ArrayLike,
    *,
    guess: Guess | None = None,
    extrapolate: bool = False,
    seed: int = 0,
    starts: int | None = None,
) -> Solution:
    """The best known optimum of one instance: from a guess of yours, or by multistart over the goal's windings.

    The solver process is kept for the next call. Threads may call this at once; they use as many as there are cores. An
    instance whose initial state or goal violates a constraint is told at once, as INFEASIBLE.

    Args:
        problem: the problem.
        p: parameters of the instance, (np,), their angles in any turn.
        guess: where the solver begins: a trajectory of one row, several of them, or a function from parameters (1, np)
            to these, such as a planner, or the method ``experts`` of a mixture. From each guess it goes to the winding
            of the goal that is nearest to its end. A guess that is not finite is not tried.
        extrapolate: accept parameters outside the problem's box.
        seed: of the random guesses.
        starts: guesses for each winding in addition to ``guess``, at most 1000: one straight line, the others random.
            By default 6, or none with a guess.

    Raises:
        TypeError: a guess that is neither trajectories nor a function that returns some.
        ValueError: more than one instance, parameters that are not finite or outside the box, starts out of range, or
            guesses of another shape.
    """
    problem = problem_of(problem)
    given = problem.check_parameters(p, extrapolate)
    if len(given) != 1:
        raise ValueError(f"solve takes one instance, got {len(given)}; ocp_envs.solve_many takes several")
    multistart = Multistart.of(starts, seed, guess is not None)
    tried = guesses_of(problem, given, guess, "guess")
    if told := told_at_once(problem, given):
        return told[0]
    with lent_solvers(problem).one() as solver:
        return solved_from(solver, given, tried, multistart)


def told_at_once(problem: OptimalControlProblem, given: Array) -> dict[int, Solution]:
    """The instances of ``problem`` with parameters ``given`` (B, np) that are infeasible without a solve, by row."""
    reasons = infeasible_rows(problem, problem.in_one_turn(given)[0])
    nothing = Solutions.empty(problem, len(problem.modes))
    failures = {row: of_instance(problem, reason) for row, reason in reasons.items()}
    return {row: Solution(given[row], nothing, Status.INFEASIBLE, why.text, why) for row, why in failures.items()}


def solved_from(solver: GuardedSolver, given: Array, guess: Sequence[Trajectory], multistart: Multistart) -> Solution:
    """The best that ``solver`` finds for one instance, with the parameters ``given`` (1, np) in any turn.

    It begins at each ``guess``, trajectories of one row in the turn of ``given``, and at those of the ``multistart``.
    """
    problem = solver.problem
    parameters, turns = problem.in_one_turn(given)
    search = _Search(solver, parameters, [each.shifted(-turns) for each in guess], multistart)
    found = search.solutions()
    modes = best_per_mode(problem, parameters[0], found)
    status, failure = (Status.SOLVED, None) if found.solved.any() else search.why()
    here, failure = replace(modes, trajectory=modes.trajectory.shifted(turns)), failure and failure.shifted(turns)
    return Solution(given[0], here, status, failure.text if failure else "", failure)


class _Guesses(NamedTuple):
    """G guesses of one instance, each with the index of a winding of the goal, (G,)."""

    trajectory: Trajectory
    windings: NDArray[np.integer]


class _Search:
    """Solves of one instance by ``solver``, which has ``parameters`` (1, np) in one turn.

    A guess that fails is given up. Only where all fail the fallback solver is used, from what is given, ``guess``, and
    from the lines of the ``multistart``.
    """

    def __init__(
        self, solver: GuardedSolver, parameters: Array, guess: Sequence[Trajectory], multistart: Multistart
    ) -> None:
        self._solver, self._problem, self._parameters = solver, solver.problem, parameters
        self._starts, self._rng = multistart.starts, np.random.default_rng(multistart.seed)
        self._surest, self._ends = self._first(guess), list[Trajectory]()

    def _first(self, guess: Sequence[Trajectory]) -> _Guesses:
        """What is given, and a line for each winding where there is a multistart."""
        windings = [np.full(len(guess), NEAREST_WINDING)]
        every = list(guess)
        if self._starts:
            every.append(self._to_each_winding("line"))
            windings.append(np.arange(len(self._problem.terminal)))
        return _Guesses(Trajectory.concatenate(every), np.concatenate(windings))

    def _to_each_winding(self, kind: GuessKind) -> Trajectory:
        count = len(self._problem.terminal)
        return guesses(self._problem, np.repeat(self._parameters, count, axis=0), np.arange(count), self._rng, kind)

    def _solve(self, tried: _Guesses, last_resort: bool = False) -> Attempts:
        attempts = self._solver.attempts(
            np.repeat(self._parameters, len(tried.windings), axis=0),
            *tried,
            retry_with_fallback=last_resort,
            rescue=last_resort,
        )
        self._ends.append(attempts.ends)
        return attempts

    def solutions(self) -> Solutions:
        """How the solves ended: all that were tried at first, or those of the last resort where none succeeded."""
        first = self._solve(self._surest).solutions
        others = [self._random(first) for _ in range(self._starts - 1)]
        solutions = first
        if others:
            windings = np.tile(np.arange(len(self._problem.terminal)), len(others))
            more = self._solve(_Guesses(Trajectory.concatenate(others), windings)).solutions
            solutions = Solutions.concatenate([first, more])
        if solutions.solved.any():
            return solutions
        self._failed = self._solve(self._surest, last_resort=True)
        return self._failed.solutions

    def _random(self, first: Solutions) -> Trajectory:
        """A random guess for each winding, near what the ``first`` solves found from lines where that is better."""
        kind, count = random_kind(self._problem), len(self._problem.terminal)
        if kind != "bend":
            return self._to_each_winding(kind)
        lines, found = self._surest.trajectory[-count:], first[-count:]
        return bends_of(self._problem, lines, found.solved, found.trajectory, self._rng)

    def why(self) -> tuple[Status, Failure]:
        """How the solves of the last resort failed, and why."""
        ends = Trajectory.concatenate(self._ends)
        statuses = self._failed.solutions.status.tolist()
        return explained(self._problem, self._parameters, self._surest.trajectory, ends, statuses)
