"""Regulators against finite differences, the Riccati equation and dense least squares."""

import control
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from moe_policy.control.lqr import Regulator
from moe_policy.control.resampling import Resampler
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.weights import TrackingWeights
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from tests.plans import DT, random_plan
from tests.small_problems import WALLED_INTEGRATOR


def test_a_regulator_that_cannot_be_computed_is_refused_in_words(monkeypatch):
    def fails(*arguments):
        raise np.linalg.LinAlgError("failed to find a finite solution")

    monkeypatch.setattr(control, "dlqr", fails)
    with pytest.raises(ValueError, match=r"no linear regulator that holds the goal with dt = 0.02 s .*declare hold"):
        Regulator(PENDULUM, 0.02)


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER, QUADCOPTER_OBSTACLE])
def test_linearisation_is_the_derivative_of_the_simulated_step(problem):
    regulator, simulator = Regulator(problem, DT), Simulator(problem, DT)
    rng = np.random.default_rng(3)
    x = problem.goal.state + 0.3 * rng.standard_normal((4, problem.system.nx))
    u = problem.goal.control + 0.05 * rng.uniform(-1, 1, (4, problem.system.nu))
    s = np.ones((4, len(problem.context)))
    a, b = regulator.linearise(x, u, s)
    epsilon = 1e-5

    def central(array, i):
        delta = np.zeros(array.shape[1])
        delta[i] = epsilon
        steps = [(x + d, u) if array is x else (x, u + d) for d in (delta, -delta)]
        forward, backward = (simulator.advance(*step, s).states for step in steps)
        return (forward - backward) / (2 * epsilon)

    for i in range(problem.system.nx):
        np.testing.assert_allclose(a[:, :, i], central(x, i), atol=1e-7)
    for i in range(problem.system.nu):
        np.testing.assert_allclose(b[:, :, i], central(u, i), atol=1e-6)


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER])
def test_long_riccati_recursion_reaches_the_algebraic_solution(problem):
    steps, nx, nu = 900, problem.system.nx, problem.system.nu
    weights = TrackingWeights(np.ones(nx), np.full(nu, 0.1), terminal=np.zeros((nx, nx)))
    regulator = Regulator(problem, DT, weights)
    states, controls = np.tile(problem.goal.state, (1, steps + 1, 1)), np.tile(problem.goal.control, (1, steps, 1))
    contexts = np.zeros((1, len(problem.context)))
    gains, norms = regulator.along(states, controls, contexts, np.array([steps]))
    a, b = regulator.linearise(problem.goal.state[None], problem.goal.control[None], contexts)
    p = solve_discrete_are(a[0], b[0], np.eye(nx), 0.1 * np.eye(nu))
    exact = np.linalg.solve(0.1 * np.eye(nu) + b[0].T @ p @ b[0], b[0].T @ p @ a[0])
    np.testing.assert_allclose(gains[0, 0], exact, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(regulator.central.gain, exact, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(norms[0, 0], regulator.central.norm, rtol=1e-5)
    assert np.abs(control.dlqr(a[0], b[0], np.eye(nx), 0.1 * np.eye(nu))[2]).max() < 1


def test_riccati_is_the_optimum_of_the_finite_horizon_problem():
    """One-row oracle: minimise Σ δxᵀQδx + δuᵀRδu + δx_TᵀPδx_T as a dense least-squares problem."""
    plan, contexts = random_plan(PENDULUM, 1, seed=5)
    reference = Resampler(PENDULUM, DT)(plan, contexts)
    regulator = Regulator(PENDULUM, DT, TrackingWeights(np.array([4.0, 9.0]), np.array([0.1])))
    steps = int(reference.steps[0])
    gains, _ = regulator.along(reference.states, reference.controls, contexts, reference.steps)
    rows = np.zeros((steps, 0))
    a, b = regulator.linearise(reference.states[0, :-1], reference.controls[0], rows)
    free, forced = np.eye(2), np.zeros((2, steps))
    blocks, targets = [], []
    root = np.linalg.cholesky(regulator.central.terminal).T
    for k in range(steps):
        free, forced = a[k] @ free, a[k] @ forced
        forced[:, k] = b[k, :, 0]
        weight = np.diag([2.0, 3.0]) if k < steps - 1 else root
        blocks.append(weight @ forced)
        targets.append(weight @ free)
    matrix = np.concatenate([*blocks, np.sqrt(0.1) * np.eye(steps)])
    target = np.concatenate([*targets, np.zeros((steps, 2))])
    optimum = np.linalg.lstsq(matrix, target, rcond=None)[0]
    np.testing.assert_allclose(gains[0, 0, 0], optimum[0], rtol=1e-6)


def test_plans_of_different_lengths_do_not_touch_each_other():
    plan, contexts = random_plan(PENDULUM, 23, seed=1)
    policy = TrackingPolicy(PENDULUM, lambda p: p)
    together = policy.follow(plan, contexts)
    for row in (0, 7, 22):
        alone = policy.follow(plan[row], contexts[row : row + 1])
        length = alone.gains.shape[1]
        np.testing.assert_allclose(together.gains[row, :length], alone.gains[0], rtol=1e-9)
        np.testing.assert_allclose(together.states[row, :length], alone.states[0], rtol=1e-12)
        np.testing.assert_array_equal(
            together.gains[row, length:],
            np.broadcast_to(policy.regulator.central.gain, together.gains[row, length:].shape),
        )


def test_a_goal_that_cannot_be_held_has_no_hold_gain():
    regulator = Regulator(WALLED_INTEGRATOR, DT)
    assert not regulator.central.gain.any()
    np.testing.assert_array_equal(regulator.central.terminal, 10 * np.diag(regulator.weights.state))


@pytest.mark.parametrize("weights", [([1.0], [1.0]), ([1.0, 1.0], [1.0], np.eye(3)), ([1.0, 1.0], [1.0, 2.0])])
def test_weights_of_the_wrong_shape_are_refused(weights):
    with pytest.raises(ValueError, match="expected"):
        Regulator(PENDULUM, DT, TrackingWeights(*weights))


@pytest.mark.parametrize("size", [1, 3, 40])
def test_regulators_of_a_plan_do_not_depend_on_its_batch(size):
    regulator, rng = Regulator(PENDULUM, DT), np.random.default_rng(size)
    steps = rng.integers(1, 30, size)
    states, controls = rng.normal(size=(size, 31, 2)), rng.uniform(-1, 1, (size, 30, 1))
    gains, norms = regulator.along(states, controls, np.zeros((size, 0)), steps)
    for row in range(size):
        alone = slice(row, row + 1)
        one = regulator.along(states[alone], controls[alone], np.zeros((1, 0)), steps[alone])
        np.testing.assert_allclose(gains[row], one[0][0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(norms[row], one[1][0], rtol=1e-12, atol=1e-12)
