"""The interior-point method in C: it solves what fatrop solves, and leaves to it what it does not."""

from __future__ import annotations

import dataclasses
import re

import casadi as ca
import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.solvers import interior
from ocp_envs.solvers.fused import stage_functions
from ocp_envs.solvers.interior import InteriorPoint
from ocp_envs.solvers.nlp import Outcome, SolverSettings, Status
from ocp_envs.solvers.solutions import make_tasks
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.support import compiler
from ocp_envs.support.compiler import CompiledNotAvailable, find_compiler
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR
from tests.solvers.programs import line
from tests.solvers.test_known_answers import CASES

RICCATI = SolverSettings(primary="riccati")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")


@pytest.fixture(scope="module")
def walled():
    return Solver(WALLED_INTEGRATOR, RICCATI)


def task_of(problem, p, **changes):
    program = transcribe(problem)
    (task,) = make_tasks(problem, program, *line(problem, p))
    return task._replace(**changes), program.bounds(task.target, task.parameter[program.nx :])


@pytest.mark.parametrize("name", ["a final equality", "an equality of controls", "a duration in p"])
def test_every_kind_of_constraint_is_kept(name):
    problem, p, cost = CASES[name]
    found = Solver(problem, RICCATI).solve(*line(problem, p), retry_with_fallback=False, rescue=False)
    assert found.status[0] == Status.SOLVED
    assert not found.fallback[0]
    assert found.cost[0] == pytest.approx(cost, rel=2e-3)


def test_costs_and_trajectories_are_those_of_fatrop():
    rng = np.random.default_rng(3)
    arguments = line(PENDULUM, PENDULUM.parameters.lower + rng.random((20, 2)) * [2 * np.pi, 4.0], 1)
    own, fatrop = (Solver(PENDULUM, settings).solve(*arguments) for settings in (RICCATI, None))
    both = own.solved & fatrop.solved & ~own.fallback
    assert both.sum() >= 15
    np.testing.assert_allclose(own.cost[both], fatrop.cost[both], rtol=1e-6)
    np.testing.assert_allclose(own.trajectory.states[both], fatrop.trajectory.states[both], atol=1e-4)


def test_multipliers_of_clearances_are_those_of_fatrop():
    blocked = dataclasses.replace(WALLED_INTEGRATOR, clearance=lambda x, s, c: [s.wall - x[1]])
    arguments = line(blocked, [-4.0, 1.0])
    own, fatrop = (Solver(blocked, settings).solve(*arguments) for settings in (RICCATI, None))
    assert own.solved[0]
    assert fatrop.multipliers.max() > 0.01
    np.testing.assert_allclose(own.multipliers, fatrop.multipliers, atol=1e-3)


def test_clearances_keep_their_margin(walled):
    problem, p = WALLED_INTEGRATOR, np.array([[4.0, 8.0]])
    tried = line(problem, p)
    margins = np.full((1, problem.knots - 1), 0.3)
    plain, wide = (walled.attempts(*tried, margins=margin).solutions for margin in (None, margins))
    assert plain.solved[0]
    assert wide.solved[0]
    distance = np.abs(wide.trajectory.states[0, 1:, 0] - 8.0) - 0.1
    assert distance.min() >= 0.3 - 1e-6


@pytest.mark.parametrize("iterations", [1, 3])
def test_it_makes_no_more_iterations_than_it_may(iterations):
    method = InteriorPoint.of(transcribe(DOUBLE_INTEGRATOR), RICCATI)
    task, bounds = task_of(DOUBLE_INTEGRATOR, [3.0, 0.5], iterations=iterations)
    assert method.run(task, *bounds) == (Outcome.STUCK, iterations)
    assert method.status(Outcome.STUCK) == Status.NOT_CONVERGED


def test_a_solve_does_not_depend_on_the_one_before():
    method = InteriorPoint.of(transcribe(DOUBLE_INTEGRATOR), RICCATI)
    first, second = (task_of(DOUBLE_INTEGRATOR, p) for p in ([3.0, 0.5], [-2.0, 0.0]))
    ends = []
    for task, bounds in (first, second, first):
        assert method.run(task, *bounds)[0] is Outcome.CONVERGED
        ends.append(method.w.copy())
    np.testing.assert_array_equal(ends[0], ends[2])


@pytest.mark.parametrize("where", ["guess", "parameter"])
def test_what_is_not_finite_breaks_it_down_at_once(where):
    method = InteriorPoint.of(transcribe(DOUBLE_INTEGRATOR), RICCATI)
    task, bounds = task_of(DOUBLE_INTEGRATOR, [3.0, 0.5])
    values = getattr(task, where).copy()
    values[1] = np.nan
    assert method.run(task._replace(**{where: values}), *bounds) == (Outcome.BROKE_DOWN, 0)
    assert method.status(Outcome.BROKE_DOWN) == Status.NOT_FINITE


def test_a_derivative_that_is_not_finite_breaks_it_down():
    def distance(x, u, s, c):
        return ca.sqrt((x[0] - 1) ** 2 + x[1] ** 2) + u[0] ** 2 / 2 + 1

    problem = dataclasses.replace(DOUBLE_INTEGRATOR, id="Distance-v0", cost_rate=distance)
    method = InteriorPoint.of(transcribe(problem), RICCATI)
    task, bounds = task_of(problem, [3.0, 0.0])
    task.guess[2:4] = 1 / transcribe(problem).state_scale[0], 0.0  # the state at the second knot
    assert method.run(task, *bounds) == (Outcome.BROKE_DOWN, 0)


def test_bounds_without_room_between_them_are_left_to_fatrop():
    method = InteriorPoint.of(transcribe(DOUBLE_INTEGRATOR), RICCATI)
    task, (lower, upper) = task_of(DOUBLE_INTEGRATOR, [3.0, 0.5])
    upper[1] = lower[1]
    assert method.run(task, lower, upper) == (Outcome.STUCK, 0)


@pytest.mark.parametrize("retry", [True, False])
def test_what_it_does_not_solve_goes_to_fatrop_and_then_to_ipopt_where_asked(retry):
    hurried = dataclasses.replace(PENDULUM, duration=(0.1, 1.0))
    found = Solver(hurried, RICCATI).solve(*line(hurried, [0.0, 0.0], 1), retry_with_fallback=retry)
    assert found.status[0] == (Status.INFEASIBLE if retry else Status.NOT_CONVERGED)
    assert found.fallback[0] == retry


@pytest.mark.parametrize("outcome", [Outcome.STUCK, Outcome.BROKE_DOWN])
def test_fatrop_comes_next(walled, monkeypatch, outcome):
    monkeypatch.setattr(walled.runner.nlp.primary, "run", lambda *arguments: (outcome, 2))
    monkeypatch.setattr(type(walled.runner.nlp), "fallback", property(lambda self: pytest.fail("IPOPT is used")))
    found = walled.solve(*line(WALLED_INTEGRATOR, [2.0, 5.0]))
    assert found.solved[0]
    assert found.fallback[0]


def test_without_a_compiler_fatrop_is_used(monkeypatch):
    monkeypatch.setattr(compiler, "find_compiler", lambda: None)
    compiler._warn_once.cache_clear()
    with pytest.warns(CompiledNotAvailable):
        found = Solver(DOUBLE_INTEGRATOR, RICCATI).solve(*line(DOUBLE_INTEGRATOR, [3.0, 0.5]))
    assert found.solved[0]
    assert not found.fallback[0]


def test_long_functions_are_not_covered(monkeypatch):
    monkeypatch.setattr(interior, "MOST_INSTRUCTIONS", 10)
    assert InteriorPoint.of(transcribe(DOUBLE_INTEGRATOR), RICCATI) is None


def test_the_constants_in_c_are_those_of_python():
    text = "".join(path.read_text() for path in interior._PROGRAM)
    names = re.search(r"enum \{ (\w+), (\w+), (\w+), MOVED \}", text).groups()
    assert list(names) == [ended.name for ended in interior._Ended]


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER], ids=lambda problem: problem.id)
def test_values_and_derivatives_are_those_of_the_program(problem):
    program = transcribe(problem)
    stage, values, *_ = stage_functions(program)
    rng = np.random.default_rng(1)
    z, s, multipliers = (0.3 * rng.standard_normal(stage.size1_in(i)) for i in range(3))
    following, cost, _, gradient, lagrangian, dynamics, _, hessian = (
        np.array(each) for each in stage(z, s, multipliers, [])
    )
    np.testing.assert_allclose(following, np.array(program.interval(z, s)[0]), rtol=1e-12)
    np.testing.assert_allclose(np.array(values(z, s)[0]), following, rtol=1e-12)
    jacobian = np.array(program.interval.jacobian()(z, s, following, cost)[0])
    np.testing.assert_allclose(dynamics.T, jacobian, atol=1e-10)
    np.testing.assert_allclose(lagrangian, gradient + dynamics @ multipliers[:, None], atol=1e-10)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-10)
