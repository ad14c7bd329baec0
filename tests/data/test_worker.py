import dataclasses
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import cloudpickle
import numpy as np
import pytest

from ocp_envs.data import worker
from ocp_envs.data.generation import generate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.nlp import Status
from tests.data.running import SMALL, InProcess, Unguarded
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.solvers.programs import DISC


def test_the_first_round_tries_every_winding(tmp_path, unguarded):
    generate(PENDULUM, tmp_path / "d", sample(PENDULUM, 7, 10), executor=InProcess(), settings=SMALL)
    assert set(np.concatenate(unguarded.asked)) == {0, 1, 2}


def test_what_no_guess_solves_gets_the_second_solver_in_the_end(tmp_path, unguarded, monkeypatch):
    """A first solver that is stuck on one problem, whatever the guess, and a second one that is not."""
    p = sample(PENDULUM, 7, 10)

    def solve(self, parameters, guesses, windings, *, retry_with_fallback=True):
        found = Solver.solve(self, parameters, guesses, windings, retry_with_fallback=retry_with_fallback)
        if not retry_with_fallback:
            stuck = (parameters == p[3]).all(axis=1)
            status = np.where(stuck, np.int8(Status.NOT_CONVERGED), found.status)
            return dataclasses.replace(found, status=status)
        return found

    monkeypatch.setattr(Unguarded, "solve", solve)
    database = generate(PENDULUM, tmp_path / "d", p, executor=InProcess(), settings=SMALL)
    rows, hard = database.stored(slice(0, 10)), (database.stored_parameters(slice(0, 10)) == p[3]).all(axis=1)
    assert (rows.status == Status.SOLVED).all()
    assert rows.solves[hard] == 3 * SMALL.starts + 3
    assert (rows.solves[~hard] <= 3 * SMALL.starts).all()


@pytest.mark.parametrize(("guess", "kinds"), [("drift", ["line", "drift"]), ("line", ["line", "line"])])
def test_guesses_after_the_first_are_of_the_kind_wanted(tmp_path, unguarded, monkeypatch, guess, kinds):
    asked, made = [], worker.guesses

    def noted(problem, parameters, windings, rng, kind):
        asked.append(kind)
        return made(problem, parameters, windings, rng, kind)

    monkeypatch.setattr(worker, "guesses", noted)
    settings = dataclasses.replace(SMALL, guess=guess)
    generate(PENDULUM, tmp_path / "d", sample(PENDULUM, 7, 10), executor=InProcess(), settings=settings)
    assert asked[:2] == kinds


def test_problems_without_a_solution_are_kept_as_such(tmp_path, unguarded, monkeypatch):
    """Too little time for any swing-up from the bottom: nothing is dropped, nothing invented."""
    hurried = dataclasses.replace(PENDULUM, duration=(0.1, 0.2))
    p = np.array([[0.0, 0.0], [np.pi, 0.0]])
    database = generate(hurried, tmp_path / "d", p, executor=InProcess(), settings=SMALL)
    bottom = int(np.flatnonzero(database.stored_parameters(slice(0, 2))[:, 0] == 0)[0])
    rows = database.stored(slice(bottom, bottom + 1))
    assert rows.status[0] == Status.INFEASIBLE
    assert np.isinf(rows.cost[0]).all()
    assert np.isnan(rows.z[0]).all()
    assert rows.failures[0] == rows.solves[0] > 0
    assert database.samples().index.tolist() == [1]


class Counted:
    closed = False

    def __init__(self, problem, settings):
        self.problem = problem

    def close(self):
        self.closed = True


def test_threads_that_solve_have_one_child_each(monkeypatch):
    """However many threads there are; another problem replaces the child."""
    monkeypatch.setattr(worker, "GuardedSolver", Counted)
    barrier = Barrier(5)

    def use(_):
        barrier.wait()
        first = worker.kept_solver(payload, SMALL.solver)
        assert worker.kept_solver(payload, SMALL.solver) is first
        assert worker.kept_solver(other, SMALL.solver) is not first
        assert first.closed
        return first

    payload, other = cloudpickle.dumps(PENDULUM), cloudpickle.dumps(DOUBLE_INTEGRATOR)
    with ThreadPoolExecutor(5) as executor:
        assert len(set(executor.map(use, range(5)))) == 5


def test_instances_whose_ends_violate_a_constraint_are_not_solved_and_stored_as_infeasible(tmp_path, unguarded):
    p = np.array([[-3.0, 0.3, 1.0], [-0.5, 0.3, 1.0], [-3.0, 1.0, 1.0]])
    settings = dataclasses.replace(SMALL, first=2, chunk=1, cold=1)
    database = generate(DISC, tmp_path / "d", p, executor=InProcess(), settings=settings)
    rows, blocked = database.stored(slice(0, 3)), database.stored_parameters(slice(0, 3))[:, 0] == -0.5
    np.testing.assert_array_equal(rows.status, np.where(blocked, Status.INFEASIBLE, Status.SOLVED))
    np.testing.assert_array_equal(rows.solves == 0, blocked)


def test_random_guesses_that_are_not_finite_are_counted_as_failures(tmp_path, unguarded, monkeypatch):
    made = worker.guesses

    def broken(problem, parameters, windings, rng, kind):
        guess = made(problem, parameters, windings, rng, kind)
        return guess if kind == "line" else dataclasses.replace(guess, states=guess.states * np.nan)

    monkeypatch.setattr(worker, "guesses", broken)
    settings = dataclasses.replace(SMALL, starts=2)
    database = generate(DOUBLE_INTEGRATOR, tmp_path / "d", [[1.0, 0.0]], executor=InProcess(), settings=settings)
    rows = database.stored(slice(0, 1))
    assert (rows.status[0], rows.solves[0], rows.failures[0]) == (Status.SOLVED, 2, 1)
