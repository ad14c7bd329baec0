import dataclasses
from functools import partial

import numpy as np
import pytest

from ocp_envs.solvers import optimum
from ocp_envs.solvers.failure import explained
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.optimum import solve
from ocp_envs.support.sharing import Loans
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, TURN, WALLED_INTEGRATOR

pytestmark = pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable")


@pytest.fixture(autouse=True)
def _solves_here(interpreted, monkeypatch):
    monkeypatch.setattr(optimum, "lent_solvers", lambda problem: Loans(partial(Solver, problem), 1))


def changed(problem, **changes):
    return dataclasses.replace(problem, id="Changed-v0", **changes)


def test_too_little_time_is_told_with_the_longest_duration_and_the_controls_at_their_bounds():
    hasty = changed(DOUBLE_INTEGRATOR, duration=(0.2, 1.0))
    solution = solve(hasty, [5.0, 0.0], starts=1)
    failure = solution.failure
    assert solution.status == Status.INFEASIBLE
    assert (failure.phase, failure.text) == ("solver", solution.reason)
    assert failure.constraint in ("the dynamics of x", "the dynamics of v", "the final x", "the final v")
    assert 0 <= failure.knot < hasty.knots
    assert failure.amount > 0.1
    assert failure.unit == "its scale"
    assert failure.nearest.finite.all()
    assert "a longer duration: the least infeasible point takes the longest, 1 s" in failure.advice
    assert str(failure).startswith(f"solver: {solution.reason}\n- try ")


def test_an_instance_that_is_infeasible_at_once_has_a_phase_of_its_own():
    failure = solve(WALLED_INTEGRATOR, [3.0, 3.05]).failure
    assert failure.phase == "instance"
    assert "clearance 0 is" in failure.text
    assert failure.advice[0].startswith("other parameters")
    assert not failure.nearest.finite.any()


def test_a_guess_along_which_a_function_is_not_finite_is_told():
    def pole(x, u, s, c):
        return 1 + u[0] ** 2 / 2 + 1e-3 / (x[0] - 0.5)

    broken, p = changed(DOUBLE_INTEGRATOR, cost_rate=pole), np.array([[1.0, 0.0]])
    line = guesses(broken, p, np.array([0]), np.random.default_rng(0), "line")
    status, failure = explained(broken, p, line, line, [Status.NOT_CONVERGED])
    assert (status, failure.phase) == (Status.NOT_FINITE, "guess")
    assert "is not finite at knot 10" in failure.text
    assert "bounds of the states that keep guesses and plans away from there" in failure.advice


def test_the_least_infeasible_point_is_the_best_of_all_attempts():
    p = np.array([[0.7, 0.1]])
    solved = solve(TURN, p[0], starts=1).trajectory
    far = dataclasses.replace(solved, states=solved.states + 0.1)
    near = dataclasses.replace(solved, states=solved.states + 0.001)
    ends = type(solved).concatenate([far, near, far])
    status, failure = explained(TURN, p, far, ends, [Status.NOT_CONVERGED] * 3)
    assert status == Status.NOT_CONVERGED
    np.testing.assert_array_equal(failure.nearest.flat(), near.flat())
    assert failure.amount == pytest.approx(0.001, rel=0.05)


def test_the_least_infeasible_point_begins_in_the_turn_of_the_parameters():
    hasty = changed(TURN, duration=(0.1, 0.3))
    here, there = (solve(hasty, [0.5 + turn, 0.0], starts=1).failure for turn in (0.0, 2 * np.pi))
    np.testing.assert_allclose(
        there.nearest.states - here.nearest.states, np.full((1, 21, 2), [2 * np.pi, 0.0]), atol=1e-6
    )


@pytest.mark.parametrize(
    ("status", "phase", "advice"),
    [
        (Status.CHECK_FAILED, "check", "more substeps"),
        (Status.TIMED_OUT, "solver", "more guesses"),
        (Status.NOT_CONVERGED, "solver", "more guesses"),
        (Status.INFEASIBLE, "solver", "another guess"),
    ],
)
def test_what_to_try_follows_from_how_the_solve_ended(status, phase, advice):
    p = np.array([[1.0, 0.0]])
    line = guesses(DOUBLE_INTEGRATOR, p, np.array([0]), np.random.default_rng(0), "line")
    found, failure = explained(DOUBLE_INTEGRATOR, p, line, line, [status])
    assert (found, failure.phase) == (status, phase)
    assert any(each.startswith(advice) for each in failure.advice)


def test_a_solver_that_leaves_no_point_is_told():
    p = np.array([[1.0, 0.0]])
    line = guesses(DOUBLE_INTEGRATOR, p, np.array([0]), np.random.default_rng(0), "line")
    nothing = DOUBLE_INTEGRATOR.unflatten(np.full((1, DOUBLE_INTEGRATOR.flat_size), np.nan))
    status, failure = explained(DOUBLE_INTEGRATOR, p, line, nothing, [Status.CRASHED])
    assert (status, failure.text) == (Status.CRASHED, "the solver ends without a point (CRASHED)")
