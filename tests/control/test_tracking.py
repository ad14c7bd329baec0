"""Tracking in the simulator."""

import dataclasses

import numpy as np
import pytest

from moe_policy.control.resampling import Resampler
from moe_policy.control.stabiliser import Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.support.clock import count_steps
from ocp_envs.trajectory import Trajectory
from tests.plans import DT, random_plan, replay
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR, rest_to_rest


def test_an_exact_plan_with_knots_at_control_steps_is_replayed_without_feedback():
    """Knots of the double integrator at control steps: the feed-forward is exact, so the feedback never acts."""
    positions = np.array([2.0, -1.0, 0.5])
    plan = Trajectory(*rest_to_rest(positions, 4.0, 21))
    policy = TrackingPolicy(DOUBLE_INTEGRATOR, lambda p: plan)
    state = policy.start(np.stack([positions, 0 * positions], axis=1))
    states, controls = replay(DOUBLE_INTEGRATOR, policy, state, plan.states[:, 0], 250)
    np.testing.assert_allclose(states[:, :201:10], plan.states, atol=1e-11)
    np.testing.assert_allclose(controls[:, :200:10], plan.controls, atol=1e-10)
    np.testing.assert_allclose(states[:, 200:], 0, atol=1e-10)
    np.testing.assert_allclose(policy.schedule(state).plan_end, 4.0)
    np.testing.assert_allclose(policy.schedule(state).evaluation, 6.0)


def test_a_plan_with_knots_between_control_steps_is_tracked():
    plan, contexts = random_plan(PENDULUM, 20, seed=2)
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    state = policy.follow(plan, contexts)
    steps = np.floor(plan.duration / DT).astype(int)
    states, _ = replay(PENDULUM, policy, state, plan.states[:, 0], int(steps.max()))
    rows = np.arange(20)
    expected = Resampler(PENDULUM, DT)(plan, contexts).states[rows, steps]
    assert np.abs(states[rows, steps] - expected).max() < 2e-3


def test_a_disturbed_initial_state_is_pulled_back_to_the_plan():
    plan, contexts = random_plan(PENDULUM, 20, seed=4)
    policy = TrackingPolicy(PENDULUM, lambda p: plan)
    start = plan.states[:, 0] + np.array([0.1, -0.1])
    steps = np.floor(plan.duration / DT).astype(int)
    states, _ = replay(PENDULUM, policy, policy.follow(plan, contexts), start, int(steps.max()))
    rows = np.arange(20)
    left = np.linalg.norm(states[rows, steps] - Resampler(PENDULUM, DT)(plan, contexts).states[rows, steps], axis=1)
    flow, x = PENDULUM.functions.flow(20), start
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


def test_nobody_to_track_is_no_error():
    policy = TrackingPolicy(PENDULUM, lambda p: random_plan(PENDULUM, len(p))[0])
    state = policy.start(np.empty((0, 2)))
    assert len(state) == len(policy.schedule(state)) == 0
    for recurrent in (None, state):
        controls, following = policy.predict(np.empty((0, 2)), recurrent, np.zeros(0, bool))
        assert controls.shape == (0, 1)
        assert len(following) == 0


def test_wild_plans_are_counted_and_never_lead_to_nan():
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


def test_a_fixed_duration_in_single_precision_does_not_count_as_clipped():
    fixed = dataclasses.replace(PENDULUM, duration=(6.1, 6.1))
    plan, _ = random_plan(fixed, 3, seed=8)
    plan = dataclasses.replace(plan, duration=np.array([np.float32(6.1), 6.1 - 1e-4, 6.1 + 1e-4], np.float64))
    policy = TrackingPolicy(fixed, lambda p: plan)
    schedule = policy.schedule(policy.start(np.array([[1.0, 0.0]] * 3)))
    np.testing.assert_array_equal(schedule.clipped, [False, True, True])


@pytest.mark.parametrize("make", [TrackingPolicy, lambda problem, planner, dt: Stabiliser(problem, dt)])
@pytest.mark.parametrize("dt", [0.0, 5.0, 1000, 10**30])
def test_control_steps_that_no_simulator_takes_are_refused_at_once(make, dt):
    with pytest.raises(ValueError, match=r"dt .*seconds"):
        make(PENDULUM, lambda p: None, dt=dt)


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
    assert policy.schedule(state).rejected.all()


def counting_planner(calls):
    def planner(p):
        calls.append(p.copy())
        knots = PENDULUM.knots
        t = np.linspace(0, 1, knots)[None, :, None]
        states = p[:, None] * (1 - t) + PENDULUM.goal.state * t
        return Trajectory(states, np.tile(p[:, None, :1] / 10, (1, knots - 1, 1)), 1 + p[:, 0] / 5)

    return planner


def test_only_rows_that_begin_are_planned_again():
    calls = []
    policy = TrackingPolicy(PENDULUM, counting_planner(calls))
    first = np.array([[1.0, 0.5], [2.0, 0.0], [3.0, -1.0]], np.float32)
    _, state = policy.predict(first, None, np.ones(3, bool))
    _, state = policy.predict(first, state, np.zeros(3, bool))
    again = np.array([[1.0, 0.5], [6.0, 0.0], [3.0, -1.0]], np.float32)
    controls, state = policy.predict(again, state, np.array([False, True, False]))
    assert [len(p) for p in calls] == [3, 1]
    np.testing.assert_array_equal(state.inner.clock, [3, 1, 3])
    alone, _ = policy.predict(again[1:2])
    np.testing.assert_allclose(controls[1], alone[0], rtol=1e-12)
    assert state.inner.gains.shape[1] == count_steps(np.array([1 + 6.0 / 5]), DT)[0] + 1


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
