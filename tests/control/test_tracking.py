"""Tracking against the simulator, finite differences, the Riccati equation and closed forms."""

from types import SimpleNamespace

import control
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import lsq_linear

from moe_policy.control.lqr import Regulator, TrackingWeights, nearest_control
from moe_policy.control.resampling import Resampler, mean_controls, states_at
from moe_policy.control.tracking import Stabilised, Stabiliser, TrackingPolicy
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.support.clock import count_steps
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR, rest_to_rest

DT = 0.02


def random_plan(problem, size, seed=0, spread=0.3):
    """Dynamically exact plans: random starts and controls, the intervals integrated finely."""
    rng = np.random.default_rng(seed)
    flow = problem.batch_flow(20)
    duration = rng.uniform(1.0, 3.0, size)
    step = duration[:, None] / (problem.knots - 1)
    box = problem.system.control
    noise = rng.uniform(-1, 1, (size, problem.knots - 1, problem.system.nu))
    controls = np.clip(problem.goal.control + spread * noise, box.lower, box.upper)
    contexts = np.zeros((size, len(problem.context)))
    states = [
        problem.start(rng.uniform(problem.parameters.lower, problem.parameters.upper, (size, len(problem.parameters))))[
            0
        ]
    ]
    for i in range(problem.knots - 1):
        states.append(flow(states[-1], controls[:, i], contexts, step)[0])
    return Trajectory(np.stack(states, axis=1), controls, duration), contexts


def replay(problem, policy, state, states, ticks, contexts=None):
    """States (B, ticks+1, nx) and controls (B, ticks, nu) of a policy in the simulator."""
    contexts = np.zeros((len(states), len(problem.context))) if contexts is None else contexts
    simulator, xs, us = Simulator(problem, policy.dt), [states], []
    for _ in range(ticks):
        u, state = policy.predict(np.concatenate([xs[-1], contexts], axis=1), state)
        us.append(u)
        xs.append(simulator.advance(xs[-1], u, contexts).states)
    return np.stack(xs, axis=1), np.stack(us, axis=1)


# -- resampling --------------------------------------------------------------------------------------------------------


def test_ticks_of_a_plan_include_the_last_partial_one():
    np.testing.assert_array_equal(count_steps(np.array([0.1, 0.1001, 0.02, 0.3, 8.0]), 0.02), [5, 6, 1, 15, 400])


def test_mean_control_is_the_integral_over_each_tick():
    plan, _ = random_plan(PENDULUM, 3)
    after = np.array([0.7])
    ticks = 160
    means = mean_controls(plan, DT, ticks, after)
    fine = (np.arange(ticks * 4000) + 0.5) * DT / 4000
    for row in range(3):
        interval = np.minimum((fine / plan.step[row]).astype(int), plan.knots - 1)
        held = np.concatenate([plan.controls[row, :, 0], after])[interval]
        np.testing.assert_allclose(means[row, :, 0], held.reshape(ticks, -1).mean(axis=1), atol=5e-4)
    total = means.sum(axis=1)[:, 0] * DT
    expected = plan.controls.sum(axis=1)[:, 0] * plan.step + after * (ticks * DT - plan.duration)
    np.testing.assert_allclose(total, expected, rtol=1e-12)


def test_hermite_is_exact_where_the_states_are_quadratic_and_the_control_jumps():
    plan = Trajectory(*rest_to_rest(np.array([2.0, -1.0]), 4.0, 21))
    times = np.linspace(0, 4.0, 173)
    states = states_at(DOUBLE_INTEGRATOR.batch_rate(), plan, np.zeros((2, 0)), times)
    exact = rest_to_rest(np.array([2.0, -1.0]), 4.0, 41)[0]
    np.testing.assert_allclose(states[:, ::43], exact[:, ::10], atol=1e-12)
    force = plan.controls[:, :1, 0]
    late = np.maximum(times - 2, 0)
    np.testing.assert_allclose(states[..., 0], np.array([[2.0], [-1.0]]) + force * (times**2 / 2 - late**2), atol=1e-12)


@pytest.mark.parametrize(("problem", "tolerance"), [(PENDULUM, 1e-5), (QUADCOPTER, 1e-3)])
def test_hermite_follows_the_true_motion_between_knots(problem, tolerance):
    plan, contexts = random_plan(problem, 5, spread=0.01)
    flow = problem.batch_flow(20)
    middle = np.full((len(plan), 1), 0.5) * plan.step[:, None]
    for i in range(0, problem.knots - 1, 5):
        expected, _ = flow(plan.states[:, i], plan.controls[:, i], contexts, middle)
        times = (i + 0.5) * plan.step[:, None]
        states = states_at(problem.batch_rate(), plan, contexts, times)
        np.testing.assert_allclose(
            states[:, 0] / problem.system.state.scale, expected / problem.system.state.scale, atol=tolerance
        )


# -- regulators --------------------------------------------------------------------------------------------------------


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
    ticks, nx, nu = 900, problem.system.nx, problem.system.nu
    weights = TrackingWeights(np.ones(nx), np.full(nu, 0.1), terminal=np.zeros((nx, nx)))
    regulator = Regulator(problem, DT, weights)
    states, controls = np.tile(problem.goal.state, (1, ticks + 1, 1)), np.tile(problem.goal.control, (1, ticks, 1))
    contexts = np.zeros((1, len(problem.context)))
    gains, metrics = regulator.along(states, controls, contexts, np.array([ticks]))
    a, b = regulator.linearise(problem.goal.state[None], problem.goal.control[None], contexts)
    p = solve_discrete_are(a[0], b[0], np.eye(nx), 0.1 * np.eye(nu))
    exact = np.linalg.solve(0.1 * np.eye(nu) + b[0].T @ p @ b[0], b[0].T @ p @ a[0])
    np.testing.assert_allclose(gains[0, 0], exact, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(regulator.hold, exact, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(metrics[0, 0], regulator.hold_metric, rtol=1e-5)
    assert np.abs(control.dlqr(a[0], b[0], np.eye(nx), 0.1 * np.eye(nu))[2]).max() < 1


def test_riccati_is_the_optimum_of_the_finite_horizon_problem():
    """One-row oracle: minimise Σ δxᵀQδx + δuᵀRδu + δx_TᵀPδx_T as a dense least-squares problem."""
    plan, contexts = random_plan(PENDULUM, 1, seed=5)
    reference = Resampler(PENDULUM, DT)(plan, contexts)
    regulator = Regulator(PENDULUM, DT, TrackingWeights(np.array([4.0, 9.0]), np.array([0.1])))
    ticks = int(reference.ticks[0])
    gains, _ = regulator.along(reference.states, reference.controls, contexts, reference.ticks)
    rows = np.zeros((ticks, 0))
    a, b = regulator.linearise(reference.states[0, :-1], reference.controls[0], rows)
    free, forced = np.eye(2), np.zeros((2, ticks))
    blocks, targets = [], []
    root = np.linalg.cholesky(regulator.terminal).T
    for k in range(ticks):
        free, forced = a[k] @ free, a[k] @ forced
        forced[:, k] = b[k, :, 0]
        weight = np.diag([2.0, 3.0]) if k < ticks - 1 else root
        blocks.append(weight @ forced)
        targets.append(weight @ free)
    matrix = np.concatenate([*blocks, np.sqrt(0.1) * np.eye(ticks)])
    target = np.concatenate([*targets, np.zeros((ticks, 2))])
    optimum = np.linalg.lstsq(matrix, target, rcond=None)[0]
    np.testing.assert_allclose(gains[0, 0, 0], optimum[0], rtol=1e-6)


def test_plans_of_different_lengths_do_not_touch_each_other():
    plan, contexts = random_plan(PENDULUM, 23, seed=1)
    policy = TrackingPolicy(PENDULUM, None)
    together = policy.follow(plan, contexts)
    for row in (0, 7, 22):
        alone = policy.follow(plan[row], contexts[row : row + 1])
        length = alone.gains.shape[1]
        np.testing.assert_allclose(together.gains[row, :length], alone.gains[0], rtol=1e-9)
        np.testing.assert_allclose(together.states[row, :length], alone.states[0], rtol=1e-12)
        np.testing.assert_array_equal(
            together.gains[row, length:], np.broadcast_to(policy.regulator.hold, together.gains[row, length:].shape)
        )


def test_a_goal_that_cannot_be_held_has_no_hold_gain():
    regulator = Regulator(WALLED_INTEGRATOR, DT)
    assert not regulator.hold.any()
    np.testing.assert_array_equal(regulator.terminal, 10 * np.diag(regulator.weights.state))


@pytest.mark.parametrize("weights", [([1.0], [1.0]), ([1.0, 1.0], [1.0], np.eye(3)), ([1.0, 1.0], [1.0, 2.0])])
def test_weights_of_the_wrong_shape_are_refused(weights):
    with pytest.raises(ValueError, match="expected"):
        Regulator(PENDULUM, DT, TrackingWeights(*weights))


def test_weights_are_validated():
    with pytest.raises(ValueError, match="positive"):
        TrackingWeights([1.0], [0.0])
    with pytest.raises(ValueError, match="not negative"):
        TrackingWeights([-1.0], [1.0])


def test_the_weights_of_controls_grow_near_their_bounds():
    box = QUADCOPTER.system.control
    weights = TrackingWeights.uniform(QUADCOPTER, 1.0, 3.0, room=0.1)
    regulator = Regulator(QUADCOPTER, DT, weights)
    middle, near, at = box.centre, box.lower + 0.8, box.upper
    found = regulator._control_weights(np.stack([middle, near, at])[None])
    np.testing.assert_allclose(found[0], np.outer([3.0, 3.0 / 0.4**2, 3.0 / 0.1**2], np.ones(4)))
    constant = Regulator(QUADCOPTER, DT, TrackingWeights.uniform(QUADCOPTER, 1.0, 3.0))
    np.testing.assert_array_equal(constant._control_weights(np.stack([middle, at])[None]), 3.0)


@pytest.mark.parametrize("room", [0.0, 1.5, np.nan])
def test_room_lies_between_nothing_and_the_middle(room):
    with pytest.raises(ValueError, match="room"):
        TrackingWeights.uniform(PENDULUM, room=room)


def test_the_nearest_control_is_that_of_a_bounded_least_squares_problem():
    rng = np.random.default_rng(0)
    box, root = QUADCOPTER.system.control, rng.normal(size=(50, 4, 4))
    wanted = rng.uniform(box.lower - 3, box.upper + 3, (50, 4))
    found = nearest_control(wanted, root.swapaxes(1, 2) @ root, box)
    for i in range(50):
        exact = lsq_linear(root[i], root[i] @ wanted[i], (box.lower, box.upper), tol=1e-14)
        excess = np.sum((root[i] @ (found[i] - wanted[i])) ** 2) / 2 - exact.cost
        assert excess < 1e-6 * (1 + exact.cost)
    clipped = np.clip(wanted, box.lower, box.upper)
    assert not np.allclose(found, clipped)
    np.testing.assert_array_equal(nearest_control(wanted, np.tile(np.diag([1.0, 2, 3, 4]), (50, 1, 1)), box), clipped)


# -- tracking ----------------------------------------------------------------------------------------------------------


def test_exact_plan_on_the_clock_is_replayed_without_feedback():
    """The double integrator with knots on ticks: the feed-forward alone is exact, so the feedback never acts."""
    starts = np.array([2.0, -1.0, 0.5])
    plan = Trajectory(*rest_to_rest(starts, 4.0, 21))
    policy = TrackingPolicy(DOUBLE_INTEGRATOR, lambda p: plan)
    state = policy.start(np.stack([starts, 0 * starts], axis=1))
    states, controls = replay(DOUBLE_INTEGRATOR, policy, state, plan.states[:, 0], 250)
    np.testing.assert_allclose(states[:, :201:10], plan.states, atol=1e-11)
    np.testing.assert_allclose(controls[:, :200:10], plan.controls, atol=1e-10)
    np.testing.assert_allclose(states[:, 200:], 0, atol=1e-10)
    np.testing.assert_allclose(policy.schedule(state).plan_end, 4.0)
    np.testing.assert_allclose(policy.schedule(state).judging, 6.0)


def test_plan_with_knots_off_the_clock_is_tracked():
    plan, contexts = random_plan(PENDULUM, 20, seed=2)
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    state = policy.follow(plan, contexts)
    ticks = np.floor(plan.duration / DT).astype(int)
    states, _ = replay(PENDULUM, policy, state, plan.states[:, 0], int(ticks.max()))
    rows = np.arange(20)
    expected = Resampler(PENDULUM, DT)(plan, contexts).states[rows, ticks]
    assert np.abs(states[rows, ticks] - expected).max() < 2e-3


def test_disturbed_start_is_pulled_back_to_the_plan():
    plan, contexts = random_plan(PENDULUM, 20, seed=4)
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    start = plan.states[:, 0] + np.array([0.1, -0.1])
    ticks = np.floor(plan.duration / DT).astype(int)
    states, _ = replay(PENDULUM, policy, policy.follow(plan, contexts), start, int(ticks.max()))
    rows = np.arange(20)
    left = np.linalg.norm(states[rows, ticks] - Resampler(PENDULUM, DT)(plan, contexts).states[rows, ticks], axis=1)
    flow, x = PENDULUM.batch_flow(20), start
    for i in range(PENDULUM.knots - 1):
        x, _ = flow(x, plan.controls[:, i], contexts, plan.step[:, None])
    open_loop = np.linalg.norm(x - plan.states[:, -1], axis=1)
    assert np.median(left) < 0.35 * np.median(open_loop)


def test_whole_turns_between_state_and_plan_do_not_matter():
    plan, contexts = random_plan(PENDULUM, 6, seed=6)
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    turned, _ = replay(PENDULUM, policy, policy.follow(plan, contexts), plan.states[:, 0] + [2 * np.pi, 0], 200)
    straight, _ = replay(PENDULUM, policy, policy.follow(plan, contexts), plan.states[:, 0], 200)
    np.testing.assert_allclose(turned - [2 * np.pi, 0], straight, atol=1e-8)


def test_hold_is_at_the_nearest_goal_and_stays():
    policy = Stabiliser(PENDULUM)
    for theta in (-np.pi, np.pi, 3 * np.pi):
        states, controls = replay(PENDULUM, policy, None, np.array([[theta + 0.15, 0.0]]), 500)
        np.testing.assert_allclose(states[0, -1], [theta, 0.0], atol=1e-3)
        assert np.abs(controls).max() <= 1


def test_controls_stay_in_their_box():
    plan, contexts = random_plan(PENDULUM, 5, seed=7)
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    _, controls = replay(PENDULUM, policy, policy.follow(plan, contexts), plan.states[:, 0] + [0.0, 4.0], 100)
    assert np.abs(controls).max() == 1.0


def wild_plans():
    plan, _ = random_plan(PENDULUM, 4, seed=8)
    states, controls, duration = plan.states.copy(), plan.controls.copy(), plan.duration.copy()
    states[0, 3, 1] = np.nan
    duration[1] = -5.0
    duration[2] = 1e300
    states[3] *= 1e200
    controls[3] *= 1e200
    return Trajectory(states, controls, duration)


def test_wild_plans_are_counted_and_never_give_nan():
    plan = wild_plans()
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    start = np.array([[1.0, 0.0]] * 4)
    state = policy.start(start)
    schedule = policy.schedule(state)
    np.testing.assert_array_equal(schedule.rejected, [True, False, False, False])
    np.testing.assert_array_equal(schedule.clipped, [False, True, True, False])
    np.testing.assert_allclose(schedule.plan_end[:3], [0.0, 0.1, 8.0])
    states, controls = replay(PENDULUM, policy, state, start, 420)
    assert np.isfinite(controls).all()
    stabilised, _ = replay(PENDULUM, Stabiliser(PENDULUM), None, start[:1], 420)
    np.testing.assert_allclose(states[0], stabilised[0], atol=1e-9)


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER, WALLED_INTEGRATOR])
@pytest.mark.parametrize("size", [1.0, 1e3, 1e150])
def test_noise_is_tracked_without_nan(problem, size):
    rng = np.random.default_rng(9)
    nx, nu = problem.system.nx, problem.system.nu
    states, controls = rng.normal(0, size, (6, problem.knots, nx)), rng.normal(0, size, (6, problem.knots - 1, nu))
    plan = Trajectory(states, controls, rng.normal(2, size, 6))
    p = rng.uniform(problem.parameters.lower, problem.parameters.upper, (6, len(problem.parameters)))
    policy = TrackingPolicy(problem, lambda p: plan)
    start, contexts = problem.start(p)
    _, controls = replay(problem, policy, policy.start(p), start, 100, contexts)
    assert np.isfinite(controls).all()
    assert np.all((controls >= problem.system.control.lower) & (controls <= problem.system.control.upper))


def test_all_plans_rejected():
    plan = Trajectory(np.full((2, 25, 2), np.nan), np.full((2, 24, 1), np.nan), np.full(2, np.nan))
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    controls, state = policy.predict(np.zeros((2, 2), np.float32))
    assert np.isfinite(controls).all()
    assert state.schedule.rejected.all()


# -- the protocol ------------------------------------------------------------------------------------------------------


def counting_planner(calls):
    def planner(p):
        calls.append(p.copy())
        knots = PENDULUM.knots
        t = np.linspace(0, 1, knots)[None, :, None]
        states = p[:, None] * (1 - t) + PENDULUM.goal.state * t
        return Trajectory(states, np.tile(p[:, None, :1] / 10, (1, knots - 1, 1)), 1 + p[:, 0] / 5)

    return planner


def test_only_started_rows_are_planned_anew():
    calls = []
    policy = TrackingPolicy(PENDULUM, counting_planner(calls))
    first = np.array([[1.0, 0.5], [2.0, 0.0], [3.0, -1.0]], np.float32)
    _, state = policy.predict(first, None, np.ones(3, bool))
    _, state = policy.predict(first, state, np.zeros(3, bool))
    again = np.array([[1.0, 0.5], [6.0, 0.0], [3.0, -1.0]], np.float32)
    controls, state = policy.predict(again, state, np.array([False, True, False]))
    assert [len(p) for p in calls] == [3, 1]
    np.testing.assert_array_equal(state.clock, [3, 1, 3])
    alone, _ = policy.predict(again[1:2])
    np.testing.assert_allclose(controls[1], alone[0], rtol=1e-12)
    assert state.gains.shape[1] == count_steps(np.array([1 + 6.0 / 5]), DT)[0] + 1


def test_single_observation():
    policy = TrackingPolicy(PENDULUM, counting_planner([]))
    one, state = policy.predict(np.array([1.0, 0.5], np.float32))
    many, _ = policy.predict(np.array([[1.0, 0.5]], np.float32))
    assert one.shape == (1,)
    np.testing.assert_array_equal(one, many[0])
    two, _ = policy.predict(np.array([1.0, 0.5], np.float32), state, np.array([False]))
    assert two.shape == (1,)


def test_parameters_and_contexts_are_read_off_the_observation():
    calls = []

    def planner(p):
        calls.append(p)
        x, u, t = rest_to_rest(p[:, 0], 4.0, 21)
        return Trajectory(x, u, t)

    policy = TrackingPolicy(WALLED_INTEGRATOR, planner)
    policy.predict(np.array([[1.0, 0.0, 7.0]]))
    np.testing.assert_array_equal(calls[0], [[1.0, 7.0]])


@pytest.mark.parametrize("shape", [(3, 3), (1,), (2, 2, 2)])
def test_observations_of_the_wrong_shape_are_refused(shape):
    with pytest.raises(ValueError, match="observations"):
        Stabiliser(PENDULUM).predict(np.zeros(shape))


def test_a_planner_with_the_wrong_number_of_plans_is_refused():
    plan, _ = random_plan(PENDULUM, 4)
    with pytest.raises(ValueError, match="2 plans"):
        TrackingPolicy(PENDULUM, lambda p: plan).start(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="parameters"):
        TrackingPolicy(PENDULUM, lambda p: plan).start(np.zeros((2, 3)))


def test_stabilised_hands_over_once_and_forgets_at_a_new_episode():
    inner = SimpleNamespace(predict=lambda o, s, e, d: (np.full((len(o), 1), 0.9), (s or 0) + 1))
    policy, holder = Stabilised(inner, PENDULUM), Stabiliser(PENDULUM)
    away, near = np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([[1.0, 0.0], [np.pi + 0.05, 0.0]])
    controls, state = policy.predict(away, None, np.ones(2, bool))
    np.testing.assert_array_equal(controls, [[0.9], [0.9]])
    controls, state = policy.predict(near, state, np.zeros(2, bool))
    np.testing.assert_allclose(controls, [[0.9], holder.predict(near)[0][1]])
    controls, state = policy.predict(away, state, np.zeros(2, bool))
    np.testing.assert_allclose(controls, [[0.9], holder.predict(away)[0][1]])
    controls, state = policy.predict(away, state, np.array([False, True]))
    np.testing.assert_array_equal(controls, [[0.9], [0.9]])
    assert state.inner == 4
