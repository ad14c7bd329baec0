import dataclasses
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from ocp_envs.data import many, worker
from ocp_envs.data.many import Optima, solve_many
from ocp_envs.solvers import optimum
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.optimum import solve
from ocp_envs.support.sharing import Loans
from tests.data.running import InProcess
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

P = np.array([[1.0, 0.0], [-2.0, 0.5], [3.0, -0.5]])
#: Nothing comes to rest within a second from far away.
HASTY = dataclasses.replace(DOUBLE_INTEGRATOR, id="Hasty-v0", duration=(0.2, 1.0))


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch):
    loans = {each.id: Loans(partial(Solver, each), 1) for each in (DOUBLE_INTEGRATOR, WALLED_INTEGRATOR, HASTY)}
    for module in (many, optimum):
        monkeypatch.setattr(module, "lent_solvers", lambda problem: loans[problem.id])
    monkeypatch.setattr(worker, "GuardedSolver", Solver)
    monkeypatch.setattr(worker, "KEPT", threading.local())


@pytest.fixture
def optima():
    return solve_many(DOUBLE_INTEGRATOR, P, starts=2)


def test_each_instance_is_solved_as_it_is_alone(optima):
    alone = [solve(DOUBLE_INTEGRATOR, p, starts=2) for p in P]
    np.testing.assert_array_equal(optima.cost, [each.cost for each in alone])
    np.testing.assert_array_equal(optima.trajectory.flat()[1], alone[1].trajectory.flat()[0])
    np.testing.assert_array_equal(optima.parameters, P)
    assert optima[2].cost == alone[2].cost


def test_an_executor_solves_the_same(optima):
    with ThreadPoolExecutor(2) as executor:
        for given in (InProcess(), executor):
            other = solve_many(DOUBLE_INTEGRATOR, P, executor=given, starts=2)
            np.testing.assert_array_equal(other.cost, optima.cost)


def test_optima_are_guesses_of_others(optima):
    again = solve_many(DOUBLE_INTEGRATOR, P + 0.01, optima.trajectory)
    assert again.solved.all()
    planned = solve_many(DOUBLE_INTEGRATOR, P + 0.01, lambda p: optima.trajectory)
    np.testing.assert_array_equal(planned.cost, again.cost)


def test_optima_are_samples_to_learn_from(optima):
    samples = optima.samples()
    np.testing.assert_array_equal(samples.cost, optima.cost)
    np.testing.assert_array_equal(samples.trajectory.flat(), optima.trajectory.flat())
    assert samples.index.tolist() == [0, 1, 2]


def test_failures_are_values_with_reasons():
    optima = solve_many(HASTY, [[0.1, 0.0], [5.0, 0.0]], starts=1)
    assert optima.status[0] == Status.SOLVED
    assert not optima.solved[1]
    assert optima.reasons[0] == ""
    assert "the best attempt violates" in optima.reasons[1]
    assert list(optima.failures) == [1]
    assert optima.failures[1].text == optima.reasons[1]
    assert np.isnan(optima.trajectory[1].flat()).all()
    assert optima.samples().index.tolist() == [0]
    assert optima.counts["SOLVED"] == 1
    assert repr(optima).startswith("<Optima of 2 instances of 'Hasty-v0': 1 ")


def test_an_infeasible_instance_is_told_among_the_others():
    optima = solve_many(WALLED_INTEGRATOR, [[3.0, -3.0], [3.0, 3.05]], starts=1)
    assert optima.status.tolist() == [Status.SOLVED, Status.INFEASIBLE]


def test_there_may_be_no_instance():
    optima = solve_many(DOUBLE_INTEGRATOR, np.empty((0, 2)))
    assert (len(optima), len(optima.trajectory), optima.mode_costs.shape) == (0, 0, (0, 1))
    assert isinstance(optima, Optima)


def test_the_number_of_workers_is_positive():
    with pytest.raises(ValueError, match="workers: expected a whole number of at least 1"):
        solve_many(DOUBLE_INTEGRATOR, P, workers=0)
