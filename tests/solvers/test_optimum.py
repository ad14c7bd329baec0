from functools import partial

import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers import optimum
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.optimum import solve
from ocp_envs.support.sharing import Loans
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, TURN

pytestmark = pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable")
P = np.array([0.7, 0.1])


class Counting(Solver):
    """Notes from how many guesses each batch begins."""

    batches: list[int] = []  # noqa: RUF012 - shared on purpose

    def attempts(self, parameters, *arguments, **named):
        self.batches.append(len(parameters))
        return super().attempts(parameters, *arguments, **named)


@pytest.fixture(autouse=True)
def batches(interpreted, monkeypatch):
    loans = {each.id: Loans(partial(Counting, each), 1) for each in (TURN, DOUBLE_INTEGRATOR, PENDULUM)}
    monkeypatch.setattr(optimum, "lent_solvers", lambda problem: loans[problem.id])
    Counting.batches.clear()
    return Counting.batches


def lines(p, windings):
    """A straight line for each winding."""
    repeated = np.repeat(p[None], len(windings), axis=0)
    return guesses(TURN, repeated, np.array(windings), np.random.default_rng(0), "line")


def test_a_guess_is_followed_to_its_own_winding_and_nothing_else_is_tried(batches):
    for winding in (0, 1):
        solution = solve(TURN, P, guess=lines(P, [winding]))
        np.testing.assert_allclose(solution.trajectory.states[0, -1], TURN.targets[winding], atol=1e-4)
    assert batches == [1, 1]


@pytest.mark.parametrize(
    "guess",
    [
        [lines(P, [0]), lines(P, [1])],
        lambda p: (lines(p[0], [0]), lines(p[0], [1])),
    ],
    ids=["several", "a function that returns several"],
)
def test_the_best_of_several_guesses_wins(guess, batches):
    solution = solve(TURN, P, guess=guess)
    assert solution.cost == pytest.approx(solve(TURN, P).cost, rel=1e-6)
    assert batches[0] == 2


def test_a_planner_is_a_guess_in_the_turn_of_the_parameters(batches):
    turned = P + np.array([4 * np.pi, 0.0])
    solution = solve(TURN, turned, guess=lambda p: lines(P, [0]).shifted(p - P))
    np.testing.assert_allclose(solution.trajectory.states[0, 0], turned)
    np.testing.assert_allclose(solution.trajectory.states[0, -1], TURN.targets[0] + [4 * np.pi, 0.0], atol=1e-4)
    assert batches == [1]


def test_a_multistart_comes_in_addition_where_it_is_asked_for(batches):
    solve(TURN, P, guess=lines(P, [0]), starts=2)
    assert batches == [1 + 2, 2]


def test_without_a_finite_guess_nothing_is_solved_and_the_reason_says_so():
    broken = Trajectory(*(np.full_like(part, np.nan) for part in vars(lines(P, [0])).values()))
    solution = solve(TURN, P, guess=broken)
    assert (solution.status, solution.reason) == (Status.NOT_FINITE, "no guess is finite")
    assert solve(TURN, P, guess=[broken, lines(P, [0])]).status == Status.SOLVED


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        (lines(P, [0, 1]), r"guess: expected states \(1, 21, 2\) .* for each of 1 instances; got \(2, 21, 2\)"),
        (lambda p: None, "guess: expected trajectories, or a function that returns some; got None"),
        (3, "guess: expected Trajectory or a sequence, each Trajectory or a function or None, got int 3"),
    ],
)
def test_what_is_no_guess_is_refused(guess, message):
    with pytest.raises((TypeError, ValueError), match=message):
        solve(TURN, P, guess=guess)


def test_several_instances_are_told_where_they_belong():
    with pytest.raises(ValueError, match=r"takes one instance, got 2; ocp_envs\.solve_many takes several"):
        solve(TURN, [P, P])


def test_guesses_of_one_winding_are_at_least_one_without_a_guess():
    with pytest.raises(ValueError, match="starts: expected a whole number in 1 … 1000, got 0"):
        solve(TURN, P, starts=0)
