import dataclasses
import pickle

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.transcription import GOAL_TOLERANCE, transcribe
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, with_states

PROBLEMS = [PENDULUM, QUADCOPTER, QUADCOPTER_OBSTACLE]
RNG = np.random.default_rng(7)


def draw(problem, size, rng=RNG):
    return problem.parameters.draw(rng, size)


def random_plans(problem, size):
    """Trajectories with arbitrary values around the goal: nothing about them is consistent."""
    x, u = problem.system.state, problem.system.control
    near = problem.goal.state + 0.2 * (RNG.random((size, problem.knots, len(x))) - 0.5) * x.width
    controls = problem.terminal.central_control + RNG.uniform(-1, 1, (size, problem.knots - 1, len(u))) * u.scale
    return Trajectory(near, controls, RNG.uniform(*problem.duration, size))


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)
def test_pack_and_unpack_are_inverse(problem):
    plans = random_plans(problem, 3)
    program = transcribe(problem)
    again = program.unpack(program.pack(plans), plans.states[:, 0])
    np.testing.assert_allclose(again.flat(), plans.flat(), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)
def test_program_is_the_problems_own_flow(problem):
    """Cost, defects and clearances of the program against the same quantities from NumPy and the batch functions."""
    program, plan = transcribe(problem), random_plans(problem, 1)
    p = draw(problem, 1)
    starts, contexts = problem.start(p)
    plan = with_states(plan, np.s_[:, 0], starts)
    cost, g = program.nlp(program.pack(plan)[0], np.concatenate([starts[0], contexts[0]]))

    m, nx = problem.knots - 1, problem.system.nx
    context = np.repeat(contexts, m, axis=0)
    following, costs = problem.functions.flow(problem.substeps)(
        plan.states[0, :-1], plan.controls[0], context, np.full((m, 1), plan.step[0])
    )
    gaps = (plan.states[0, 1:] - following) / problem.system.state.scale
    (clearances,) = problem.functions.clearances()(plan.states[0, 1:], context)
    g = np.array(g).ravel()
    is_gap = np.ones(len(g), dtype=bool)
    is_gap[program.rows.clearances] = False
    np.testing.assert_allclose(float(cost), costs.sum(), rtol=1e-10)
    np.testing.assert_allclose(g[is_gap].reshape(m, nx + 1), np.c_[gaps, np.zeros(m)], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(g[program.rows.clearances], clearances, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)
def test_bounds_contain_the_boxes_and_pin_the_goal(problem):
    program = transcribe(problem)
    lower, upper = program.bounds(len(problem.targets) - 1, problem.context.centre)
    low = program.unpack(lower[None], problem.system.state.lower[None])
    high = program.unpack(upper[None], problem.system.state.upper[None])
    state, control = problem.system.state, problem.system.control
    for plan, expected in ((low, (state.lower, control.lower)), (high, (state.upper, control.upper))):
        np.testing.assert_allclose(plan.states[0, :-1], np.tile(expected[0], (problem.knots - 1, 1)))
        np.testing.assert_allclose(plan.controls[0], np.tile(expected[1], (problem.knots - 1, 1)), atol=1e-12)
    np.testing.assert_allclose([low.duration[0], high.duration[0]], problem.duration)
    goal_box = GOAL_TOLERANCE * problem.system.state.scale
    np.testing.assert_allclose(low.states[0, -1], problem.targets[-1] - goal_box, atol=1e-12)
    np.testing.assert_allclose(high.states[0, -1], problem.targets[-1] + goal_box, atol=1e-12)


@pytest.mark.parametrize("shortest", [0.2, 10.0, 12.0])
def test_another_duration_stays_within_its_bounds(shortest):
    program = transcribe(dataclasses.replace(DOUBLE_INTEGRATOR, duration=(shortest, 12.0)))
    bounds = program.bounds(0, np.zeros(0))
    longer = program.unpack(program.with_duration(program.lower, 0.75, *bounds)[None], np.zeros((1, 2)))
    assert longer.duration[0] == pytest.approx(max(9.0, shortest))


def test_program_survives_pickling():
    program = transcribe(QUADCOPTER_OBSTACLE)
    again = pickle.loads(pickle.dumps(program))
    point = [RNG.random(program.nlp.numel_in(i)) for i in range(2)]
    for a, b in zip(program.nlp(*point), again.nlp(*point)):
        np.testing.assert_array_equal(np.array(a), np.array(b))


def test_derivatives_against_finite_differences():
    program = transcribe(PENDULUM)
    w, p = ca.MX.sym("w", len(program.lower)), ca.MX.sym("p", 2)
    jacobian = ca.Function("J", [w, p], [ca.jacobian(program.nlp(w, p)[1], w)])
    plan = guesses(PENDULUM, draw(PENDULUM, 1), np.array([1]), RNG, "line")
    at, parameter = program.pack(plan)[0], np.array([0.3, 0.1])
    step = 1e-6
    columns = [
        np.array(program.nlp(at + d, parameter)[1] - program.nlp(at - d, parameter)[1]).ravel() / (2 * step)
        for d in np.eye(len(at)) * step
    ]
    np.testing.assert_allclose(np.array(jacobian(at, parameter)), np.array(columns).T, atol=1e-7)


@pytest.mark.parametrize(
    ("problem", "tolerance"), [(PENDULUM, 2e-4), (QUADCOPTER, 3e-3)], ids=["pendulum", "quadcopter"]
)
def test_map_follows_the_true_equation(problem, tolerance):
    """One interval of a typical plan against SciPy's DOP853, in scaled units."""
    system = problem.system
    step = 0.5 * problem.duration[1] / (problem.knots - 1)
    x = problem.goal.state + 0.3 * system.state.scale * RNG.uniform(-1, 1, (20, system.nx))
    u = problem.terminal.central_control + 0.5 * system.control.scale * RNG.uniform(-1, 1, (20, system.nu))
    s = np.zeros((20, len(problem.context)))
    following, cost = problem.functions.flow(problem.substeps)(x, u, s, np.full((20, 1), step))
    rate = problem.functions.rate()
    for i in range(20):

        def f(t, y, i=i):
            derivative, running = rate(y[None, :-1], u[i : i + 1], s[i : i + 1])
            return np.append(derivative[0], running[0])

        true = solve_ivp(f, (0, step), np.append(x[i], 0), method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        assert np.abs((following[i] - true[:-1]) / system.state.scale).max() < tolerance
        assert cost[i, 0] == pytest.approx(true[-1], rel=tolerance)
