"""advance() against an independent integrator, and under bad input."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ocp_envs
from ocp_envs.control_step import MOST_SUBSTEPS
from ocp_envs.envs.simulation import Simulator, largest_cost_rate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE

PROBLEMS = [ocp_envs.load(name) for name in ocp_envs.names()]
each_problem = pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)


def draw(box, rows, seed, fraction=1.0):
    """Uniform in the middle ``fraction`` of a box."""
    centre, half = box.centre, box.width / 2
    return centre + fraction * half * np.random.default_rng(seed).uniform(-1, 1, (rows, len(box)))


def draw_all(problem, rows, fraction=1.0):
    boxes = (problem.system.state, problem.system.control, problem.context)
    return [draw(box, rows, seed, fraction) for seed, box in enumerate(boxes)]


def dop853(problem, x, u, s, dt, w=0.0):
    rate = problem.functions.rate()

    def derivative(t, y):
        velocity, cost = rate(y[None, :-1], u[None], s[None])
        return np.append(velocity[0] + w, cost[0])

    solution = solve_ivp(derivative, (0, dt), np.append(x, 0.0), method="DOP853", rtol=1e-12, atol=1e-12)
    return solution.y[:-1, -1], solution.y[-1, -1]


@each_problem
def test_agrees_with_dop853(problem):
    x, u, s = draw_all(problem, 25, fraction=0.3)
    step = Simulator(problem, 0.02).advance(x, u, s)
    for i in range(len(x)):
        state, cost = dop853(problem, x[i], u[i], s[i], 0.02)
        np.testing.assert_allclose(step.states[i], state, atol=5e-6)
        assert step.cost[i] == pytest.approx(cost, abs=5e-6)
    assert not step.left_box.any()


@each_problem
def test_converges_with_order_four(problem):
    x, u, s = draw_all(problem, 20, fraction=0.2)
    dt = max(0.1, problem.horizon.longest / 100)  # where all is slow, shorter steps have no errors but rounding
    reference = np.array([dop853(problem, *row, dt)[0] for row in zip(x, u, s)])
    errors = [np.linalg.norm(Simulator(problem, dt, n).advance(x, u, s).states - reference) for n in (2, 4, 8)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 4) < 0.35), (errors, orders)


def test_a_control_step_takes_runge_kutta_steps_of_at_most_20_ms():
    assert [Simulator(PENDULUM, dt).substeps for dt in (0.001, 0.02, 0.021, 0.1)] == [1, 1, 2, 5]


@each_problem
def test_disturbance_is_added_to_the_derivative(problem):
    x, u, s = draw_all(problem, 5, fraction=0.3)
    w = np.random.default_rng(3).normal(size=x.shape)
    step = Simulator(problem, 0.02).advance(x, u, s, w)
    for i in range(len(x)):
        state, _ = dop853(problem, x[i], u[i], s[i], 0.02, w[i])
        np.testing.assert_allclose(step.states[i], state, atol=5e-6)
    none = Simulator(problem, 0.02).advance(x, u, s, np.zeros_like(x))
    np.testing.assert_allclose(none.states, Simulator(problem, 0.02).advance(x, u, s).states, atol=1e-14)


@each_problem
def test_nothing_but_numbers_in_the_boxes_comes_out(problem):
    x, u, s = draw_all(problem, 60)
    generator = np.random.default_rng(5)
    for array, values in ((x, [np.nan, np.inf, -np.inf, 1e300]), (u, [np.nan, np.inf, -np.inf, 1e300])):
        rows = generator.integers(len(array), size=20)
        array[rows, generator.integers(array.shape[1], size=20)] = generator.choice(values, size=20)
    step = Simulator(problem, 0.02).advance(x, u, s)
    box = problem.system.state
    assert box.contains(step.states).all()
    assert np.isfinite(step.cost).all()
    assert np.isfinite(step.violation).all()
    assert (step.violation >= 0).all()
    assert step.left_box[~np.isfinite(x).all(axis=1)].all()
    assert not (step.reached & step.left_box).any()


def test_controls_are_clipped_and_nan_is_the_lower_bound():
    simulator = Simulator(PENDULUM, 0.02)
    x, s = np.zeros((4, 2)), np.zeros((4, 0))
    wild = simulator.advance(x, [[7.0], [-np.inf], [np.nan], [0.5]], s)
    tame = simulator.advance(x, [[1.0], [-1.0], [-1.0], [0.5]], s)
    np.testing.assert_array_equal(wild.states, tame.states)
    np.testing.assert_array_equal(wild.cost, tame.cost)


def test_goal_ball_is_open_and_knows_whole_turns():
    simulator = Simulator(PENDULUM, 1e-9)
    theta = np.pi + np.array([0.0, 0.0999, 0.1001, -0.0999, 2 * np.pi, -4 * np.pi, 1.0])
    x = np.stack([theta, np.zeros_like(theta)], axis=1)
    step = simulator.advance(x, np.zeros((7, 1)), np.zeros((7, 0)))
    assert step.reached.tolist() == [True, True, False, True, True, True, False]


def test_leaving_the_box_clips_the_state():
    x = np.array([[0.0, 6.0], [6 * np.pi - 1e-3, 5.9], [0.0, 0.0]])
    step = Simulator(PENDULUM, 0.02).advance(x, np.ones((3, 1)), np.zeros((3, 0)))
    assert step.left_box.tolist() == [True, True, False]
    assert step.states[0, 1] == 6.0
    assert step.states[1, 0] == 6 * np.pi


def test_violation_is_the_depth_in_the_sphere_at_the_end_of_the_step():
    problem = QUADCOPTER_OBSTACLE
    x = np.zeros((3, 12))
    x[:, 0] = [0.0, 2.5, 4.0]
    s = np.tile([1.0, 0.0, 0.0, 2.0], (3, 1))
    step = Simulator(problem, 0.02).advance(x, np.tile(problem.terminal.central_control, (3, 1)), s)
    np.testing.assert_allclose(step.violation, [1.0, 0.5, 0.0], atol=1e-9)


@each_problem
def test_no_point_of_the_boxes_costs_more_than_the_largest_rate(problem):
    x, u, s = draw_all(problem, 20_000)
    x[:10_000] = np.where(x[:10_000] > 0, problem.system.state.upper, problem.system.state.lower)
    rates = problem.functions.rate()(x, u, s)[1]
    assert rates.max() <= largest_cost_rate(problem) < 20 * rates.max()


def test_largest_rate_of_the_pendulum():
    assert largest_cost_rate(PENDULUM) == 2.0


def test_mismatch_is_a_problem_with_other_constants():
    x, u, s = np.array([[1.0, 0.0]]), np.zeros((1, 1)), np.zeros((1, 0))
    heavy = Simulator(PENDULUM.with_constants(gravity=2.0), 0.01).advance(x, u, s).states[0]
    light = Simulator(PENDULUM, 0.01).advance(x, u, s).states[0]
    assert heavy[1] == pytest.approx(2 * light[1], rel=1e-4)


@pytest.mark.filterwarnings("ignore:Root-v0. cost_rate is not finite:UserWarning")
def test_a_cost_that_is_not_a_number_counts_as_leaving():
    import casadi as ca

    problem = dataclasses.replace(PENDULUM, id="Root-v0", cost_rate=lambda x, u, s, c: ca.sqrt(3 - x[1]))
    step = Simulator(problem, 0.02).advance([[0.0, 0.0], [0.0, 5.0]], np.zeros((2, 1)), np.zeros((2, 0)))
    assert step.left_box.tolist() == [False, True]
    assert np.isfinite(step.cost).all()


@pytest.mark.parametrize(
    ("dt", "message"),
    [
        (10.0, "at most the longest duration of a plan, 8 s, got 10; dt is in seconds"),
        (2**63, "dt is in seconds"),
        (1e308, "dt is in seconds"),
        (5.0, "more than 100 Runge-Kutta steps, as longest_substep = 0.02 s; dt is in seconds"),
    ],
)
def test_control_steps_longer_than_any_in_use_are_refused_at_once(dt, message):
    with pytest.raises(ValueError, match=message):
        Simulator(PENDULUM, dt)
    assert Simulator(PENDULUM, 2.0).substeps == MOST_SUBSTEPS


def test_other_longest_substeps_allow_other_control_steps():
    slow = dataclasses.replace(PENDULUM, longest_substep=0.1)
    assert Simulator(slow, 5.0).substeps == 50


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf])
def test_refuses_a_bad_dt(dt):
    with pytest.raises(ValueError, match=r"dt( must be a positive|: expected a finite) number"):
        Simulator(PENDULUM, dt)


def test_refuses_wrong_shapes():
    simulator = Simulator(PENDULUM, 0.02)
    with pytest.raises(ValueError, match=r"controls of shape \(3, 1\), got \(2, 1\)"):
        simulator.advance(np.zeros((3, 2)), np.zeros((2, 1)), np.zeros((3, 0)))
    with pytest.raises(ValueError, match="states"):
        simulator.advance(np.zeros(2), np.zeros((1, 1)), np.zeros((1, 0)))
    with pytest.raises(ValueError, match="substep"):
        Simulator(PENDULUM, 0.02, 0)
    with pytest.raises(ValueError, match=r"size: expected a whole number in 1"):
        simulator.control_step(0)


@pytest.mark.parametrize("disturbed", [False, True])
def test_a_step_in_place_equals_advance(disturbed):
    x, u, s = draw_all(QUADCOPTER_OBSTACLE, 6)
    w = np.random.default_rng(3).normal(size=x.shape) if disturbed else None
    simulator = Simulator(QUADCOPTER_OBSTACLE, 0.02)
    expected = simulator.advance(x, u, s, w)
    step = simulator.control_step(6, disturbed)
    step.state[:], step.control[:], step.context[:] = x, u, s
    step.disturbance[:] = w if disturbed else 0.0
    assert step.disturbance.shape == (6, 12 if disturbed else 0)
    step.evaluate()
    np.testing.assert_array_equal(step.following, expected.states)
    results = [step.cost, step.violation, step.reached, step.left_box]
    np.testing.assert_array_equal(results, [expected.cost, expected.violation, expected.reached, expected.left_box])


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda step: pickle.loads(pickle.dumps(step))])
def test_a_copied_step_has_the_values_and_shares_nothing(duplicate):
    step = Simulator(PENDULUM, 0.02).control_step(2)
    step.state[:], step.control[:] = [[1.0, 0.5], [2.0, 0.0]], [[1.0], [-1.0]]
    step.evaluate()
    other = duplicate(step)
    for name in ("state", "control", "following", "cost"):
        np.testing.assert_array_equal(getattr(other, name), getattr(step, name))
    other.control[:] = 0.0
    other.evaluate()
    assert not np.array_equal(other.cost, step.cost)
    assert step.control[0, 0] == 1.0
