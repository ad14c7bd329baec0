"""Policies that act on an estimate of the state."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

import moe_policy
from moe_policy.control.kalman import KalmanFilter
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.system import Box, Coordinate
from tests.closed_loop import PARAMETERS, constant, rest_planner
from tests.small_problems import DOUBLE_INTEGRATOR

DT = 0.02
#: The double integrator with stronger controls and an acceleration by the wind, of which the model knows nothing.
WINDY = dataclasses.replace(
    DOUBLE_INTEGRATOR,
    id="Windy-v0",
    system=dataclasses.replace(
        DOUBLE_INTEGRATOR.system,
        control=Box((Coordinate("u", -2.0, 2.0, "N"),)),
        constants={"mass": 1.0, "wind": 0.0},
        dynamics=lambda x, u, c: [x[1], u[0] / c.mass + c.wind],
    ),
)
NOISE = np.array([0.05, 0.02])


def tracking(problem=DOUBLE_INTEGRATOR):
    return moe_policy.TrackingPolicy(problem, rest_planner)


def flown(policy, problem=DOUBLE_INTEGRATOR, p=PARAMETERS, **plant):
    envs = moe_policy.environments(problem, len(p), **plant)
    envs.reset(seed=3)
    return moe_policy.rollout(envs, policy, p)


def test_without_options_a_policy_acts_as_before():
    plain, wrapped = flown(tracking()), flown(moe_policy.Estimated(tracking()))
    np.testing.assert_array_equal(wrapped.cost, plain.cost)
    np.testing.assert_array_equal(wrapped.plan_end_error, plain.plan_end_error)


@pytest.mark.parametrize("delay", [1, 10, 25])
def test_a_delay_is_predicted_over(delay):
    late = flown(tracking(), delay=delay)
    predicted = flown(moe_policy.Estimated(tracking(), delay=delay), delay=delay)
    assert (predicted.plan_end_error < 0.02).all()
    assert predicted.plan_end_error.max() < late.plan_end_error.max()
    np.testing.assert_array_equal(predicted.evaluation_time, late.evaluation_time)


def test_an_offset_is_removed_along_a_plan_and_at_the_goal():
    plant = {"constants": {"wind": 0.3}}
    plain = flown(tracking(WINDY), WINDY, **plant)
    removed = flown(moe_policy.Estimated(tracking(WINDY), offset=True), WINDY, **plant)
    assert (removed.final_error < 0.1 * plain.final_error).all()
    assert (removed.plan_end_error < 0.05).all()


def test_a_policy_without_a_plan_is_evaluated_after_its_first_entry():
    policy = moe_policy.Estimated(moe_policy.Stabiliser(WINDY), offset=True)
    assert policy.schedule(policy.start(PARAMETERS)) is None
    episodes = flown(policy, WINDY, constants={"wind": 0.3})
    assert episodes.success.all()
    assert np.isnan(episodes.plan_end_error).all()


def test_noise_is_filtered():
    noisy = flown(tracking(), observation_noise=NOISE)
    filtered = flown(moe_policy.Estimated(tracking(), noise=NOISE), observation_noise=NOISE)
    assert filtered.final_error.mean() < 0.5 * noisy.final_error.mean()


def test_the_covariance_converges_to_that_of_the_riccati_equation():
    disturbance = np.array([0.0, 1.0])
    kalman = KalmanFilter(DOUBLE_INTEGRATOR, DT, NOISE, disturbance, np.zeros(1))
    belief, zero = kalman.begun(np.zeros((1, 2))), np.zeros((1, 1))
    for _ in range(2000):
        belief = kalman(belief, zero, np.zeros((1, 0)), np.zeros((1, 2)))
    a, r = np.array([[1.0, DT], [0.0, 1.0]]), np.diag(NOISE**2)
    q = np.diag(np.maximum(DT * disturbance, 1e-5) ** 2)
    before = solve_discrete_are(a.T, np.eye(2), q, r)
    expected = before - before @ np.linalg.inv(before + r) @ before
    np.testing.assert_allclose(belief.covariance[0, :2, :2], expected, rtol=1e-6)
    np.testing.assert_array_equal(belief.offset, 0)


def test_whole_turns_of_an_angle_are_no_innovation():
    kalman = KalmanFilter(PENDULUM, DT, np.full(2, 0.1), np.zeros(2), np.zeros(1))
    one, other = (
        kalman(kalman.begun(np.zeros((1, 2))), np.zeros((1, 1)), np.zeros((1, 0)), np.array([[0.1 + turn, 0.0]]))
        for turn in (0.0, 2 * np.pi)
    )
    np.testing.assert_allclose(one.states, other.states, atol=1e-12)


@pytest.mark.parametrize("delay", [0, 3])
def test_an_episode_that_begins_in_the_batch_begins_as_alone(delay):
    policy, none = moe_policy.Estimated(tracking(), delay=delay, offset=True), np.zeros(3, bool)
    state = None
    for _ in range(5):
        _, state = policy.act(PARAMETERS, state, none)
    controls, state = policy.act(PARAMETERS, state, np.array([False, True, False]))
    alone, fresh = policy.act(PARAMETERS[1:2], None, none[:1])
    np.testing.assert_allclose(controls[1], alone[0], atol=1e-12)
    assert state.inner.clock.tolist() == [6 + delay, 1 + delay, 6 + delay]
    assert fresh.inner.clock.tolist() == [1 + delay]


def test_any_policy_is_wrapped_if_it_is_known_what_it_acts_on():
    with pytest.raises(ValueError, match=r"has no problem or no control period; give problem=… and dt=…"):
        moe_policy.Estimated(constant(0.5))
    policy = moe_policy.Estimated(constant(0.5), DOUBLE_INTEGRATOR, DT, delay=2, noise=0.1)
    actions, _ = policy.predict(PARAMETERS)
    np.testing.assert_array_equal(actions, np.float32(0.5))


@pytest.mark.parametrize("value", [-0.1, [0.1, np.nan], [0.1, 0.1, 0.1]])
@pytest.mark.parametrize("name", ["noise", "disturbance"])
def test_deviations_are_one_number_or_one_for_each_coordinate(name, value):
    with pytest.raises(ValueError, match=f"{name}: expected standard deviations ≥ 0, one number or 2"):
        moe_policy.Estimated(tracking(), **{name: value})
