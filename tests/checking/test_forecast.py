"""The forecast of an episode is the episode."""

import dataclasses

import numpy as np
import pytest

import moe_policy
from moe_policy.checking.forecast import Forecast
from moe_policy.planners.stored import StoredPlans
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.sets.sampling import sample
from ocp_envs.support.compiler import find_compiler
from tests.closed_loop import rest_planner
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR


def flown(problem, p, plans, dt=0.02, **plant):
    policy = moe_policy.TrackingPolicy(problem, StoredPlans(p, plans), dt)
    return moe_policy.rollout(moe_policy.environments(problem, len(p), dt, **plant), policy, p)


def assert_forecast(problem, p, plans, **arguments):
    predicted, episodes = Forecast(problem, **arguments)(p, plans), flown(problem, p, plans, **arguments)
    np.testing.assert_allclose(predicted.final_error, episodes.plan_end_error, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(predicted.rejected, episodes.rejected)
    early = predicted.final_error < problem.goal.radius
    np.testing.assert_allclose(predicted.cost[early], episodes.cost[early], rtol=1e-9)
    assert (np.maximum(0.0, -predicted.clearance) <= np.fmax(episodes.violation, episodes.knot_violation) + 1e-12).all()
    clear = (episodes.violation == 0) & ~(episodes.knot_violation > 0)
    expected = early & episodes.success & clear & ~episodes.left_box & ~episodes.rejected
    np.testing.assert_array_equal(predicted.success, expected)
    return predicted


@pytest.fixture(params=["compiled", "NumPy"], autouse=True)
def way(request, monkeypatch):
    """Episodes are run by a compiled program, or with NumPy where there is no compiler."""
    if request.param == "NumPy":
        monkeypatch.setenv("CC", "none")
    elif find_compiler() is None:
        pytest.skip("needs a C compiler")


@pytest.mark.parametrize("dt", [0.02, 0.05])
def test_the_forecast_of_tracked_plans_is_the_episode_up_to_the_plans_end(dt):
    planner, p = moe_policy.load(PENDULUM, "snn"), sample(PENDULUM, 5, 40)
    predicted = assert_forecast(PENDULUM, p, planner(p), dt=dt)
    assert 0 < predicted.success.sum() < len(p)
    assert (predicted.clearance == np.inf).all()


def test_paths_are_checked_at_control_steps_and_knots():
    planner, p = moe_policy.load(QUADCOPTER_OBSTACLE, "snn"), sample(QUADCOPTER_OBSTACLE, 5, 30)
    plans = planner(p)
    predicted, episodes = assert_forecast(QUADCOPTER_OBSTACLE, p, plans), flown(QUADCOPTER_OBSTACLE, p, plans)
    assert 0 < predicted.success.sum() < len(p)
    deepest = np.maximum(episodes.violation, episodes.knot_violation)
    before = ~episodes.left_box & (episodes.violation > 0)
    assert before.any()
    np.testing.assert_allclose(np.maximum(0.0, -predicted.clearance)[before], deepest[before], atol=1e-9)


def test_plans_that_fail_are_told_apart():
    p = np.array([[2.0, 0.0], [-1.0, 0.0], [4.0, 0.0], [0.5, 0.0]])
    plans = rest_planner(p)
    states, controls, duration = plans.states.copy(), plans.controls.copy(), plans.duration.copy()
    states[1] = np.nan
    states[2], controls[2], duration[2] = [19.0, 9.0], 1.0, 12.0
    predicted = assert_forecast(
        DOUBLE_INTEGRATOR, p, dataclasses.replace(plans, states=states, controls=controls, duration=duration)
    )
    assert predicted.success.tolist() == [True, False, False, True]
    assert predicted.rejected.tolist() == [False, True, False, False]
    assert predicted.left_box.tolist() == [False, False, True, False]


def test_a_wall_on_the_way_is_no_success():
    p = np.array([[2.0, 5.0], [2.0, 1.0], [-1.0, 5.0]])
    predicted = assert_forecast(WALLED_INTEGRATOR, p, rest_planner(p))
    assert predicted.success.tolist() == [True, False, True]
    np.testing.assert_allclose(predicted.clearance, [2.9, -0.1, 4.9], atol=0.02)


def test_another_plant_is_simulated_where_it_is_named():
    """The plan and the regulator are those of the nominal problem; only the plant differs."""
    planner, p = moe_policy.load(PENDULUM, "moe-custom"), sample(PENDULUM, 5, 10)
    name, value = next(iter(PENDULUM.system.constants.items()))
    other, plans = {name: 1.05 * value}, planner(p)
    predicted = Forecast(PENDULUM, plant=PENDULUM.with_constants(**other))(p, plans)
    episodes = flown(PENDULUM, p, plans, constants=other)
    np.testing.assert_allclose(predicted.final_error, episodes.plan_end_error, rtol=1e-9)
    assert (predicted.final_error != Forecast(PENDULUM)(p, plans).final_error).all()


def test_the_forecast_of_no_plans_is_empty():
    p = np.zeros((0, 2))
    assert len(Forecast(PENDULUM)(p, moe_policy.load(PENDULUM, "snn")(p))) == 0


def test_terminal_regulation_must_keep_the_state_at_the_goal_and_clear():
    """A plan that ends in the goal ball with some speed drifts on while it is regulated, here into a wall."""
    p, held = np.array([[2.0, -0.1085], [2.0, -0.5]]), dataclasses.replace(WALLED_INTEGRATOR, hold=5.0)
    plans = rest_planner(p)
    late = plans.states.copy()
    late[:, -1, 1], late[:, -2, 0], late[:, -2, 1] = -0.045, late[:, -2, 0] + 0.009, late[:, -2, 1] - 0.045
    predicted = assert_forecast(held, p, dataclasses.replace(plans, states=late))
    assert (predicted.final_error < held.goal.radius).all()
    assert predicted.success.tolist() == [False, True]
