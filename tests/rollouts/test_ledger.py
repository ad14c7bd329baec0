"""Entries, evaluations, costs and violations of episodes against closed forms and counts by hand."""

import numpy as np

from moe_policy.control.stabiliser import Stabilised
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.rollouts.ledger import Violations
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.trajectory import Trajectory
from tests.closed_loop import PARAMETERS, constant, rest_planner, vector
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR


def test_passing_through_the_ball_is_reaching_but_not_success():
    swing = constant(0.0)
    through = np.array([[np.pi - 0.3, 0.31]])  # just enough energy to pass upright slowly
    episodes = rollout(vector(PENDULUM, 1), swing, through)
    assert episodes.reached.all()
    assert not episodes.success.any()
    np.testing.assert_allclose(episodes.cost, episodes.entry_time, rtol=1e-9)  # L = 1 + 0²
    held = rollout(vector(PENDULUM, 1), Stabilised(swing, PENDULUM), through)
    assert held.success.all()
    np.testing.assert_allclose(held.cost, episodes.cost, rtol=1e-12)


def test_never_reaching_costs_the_whole_episode():
    episodes = rollout(vector(PENDULUM, 1), constant(0.0), [[0.0, 0.0]], horizon=3.0)
    assert not episodes.reached.any()
    np.testing.assert_allclose(episodes.cost, 3.0)
    assert np.isnan(episodes.entry_time).all()
    assert np.isnan(episodes.plan_end_error).all()
    np.testing.assert_allclose(episodes.final_error, np.pi)


def test_leaving_the_box_is_charged_and_ends_the_episode():
    policy = constant(1.0)
    episodes = rollout(vector(DOUBLE_INTEGRATOR, 2), policy, [[5.0, 1.0], [-5.0, -1.0]], record=True)
    np.testing.assert_array_equal(episodes.left_box, [True, True])
    assert not episodes.success.any()
    assert (episodes.evaluation_time < 10).all()
    # L ≤ 1.5: the steps before at 1.5 (u = 1), the rest of 15 s at the largest rate, which is 1.5 as well.
    np.testing.assert_allclose(episodes.cost, 15 * 1.5, rtol=1e-6)
    last = np.isfinite(episodes.states[0, :, 0]).sum() - 1
    np.testing.assert_allclose(last * 0.02, episodes.evaluation_time[0])


def test_a_planner_that_leaves_the_box_fails_at_its_end():
    def runaway(p):
        return Trajectory(np.tile([[[19.0, 9.0]]], (len(p), 21, 1)), np.ones((len(p), 20, 1)), np.full(len(p), 12.0))

    episodes = rollout(vector(DOUBLE_INTEGRATOR, 1), TrackingPolicy(DOUBLE_INTEGRATOR, runaway), [[5.0, 1.0]])
    assert episodes.left_box.all()
    assert not episodes.success.any()
    np.testing.assert_allclose(episodes.plan_end_error, episodes.final_error)


def test_failed_plans_hold_and_are_counted():
    def planner(p):
        plan = rest_planner(p)
        states, duration = plan.states.copy(), plan.duration.copy()
        states[0] = np.nan
        duration[1] = 100.0
        return Trajectory(states, plan.controls, duration)

    episodes = rollout(vector(DOUBLE_INTEGRATOR, 3), TrackingPolicy(DOUBLE_INTEGRATOR, planner), PARAMETERS)
    np.testing.assert_array_equal(episodes.rejected, [True, False, False])
    np.testing.assert_array_equal(episodes.clipped, [False, True, False])
    np.testing.assert_allclose(episodes.evaluation_time, [2.0, 14.0, 6.0])
    np.testing.assert_allclose(episodes.plan_end_error[0], 2.0)
    assert episodes.success[2]


def test_a_goal_that_cannot_be_held_is_evaluated_at_the_plans_end():
    p = np.array([[2.0, 5.0], [-1.0, 5.0]])
    episodes = rollout(vector(WALLED_INTEGRATOR, 2), TrackingPolicy(WALLED_INTEGRATOR, rest_planner), p)
    np.testing.assert_allclose(episodes.evaluation_time, 4.0)
    np.testing.assert_array_equal(episodes.final_error, episodes.plan_end_error)
    assert episodes.success.all()
    np.testing.assert_array_equal(episodes.violation, [0.0, 0.0])
    np.testing.assert_array_equal(episodes.knot_violation, [0.0, 0.0])


def test_violation_over_the_path_and_at_the_knots():
    """The wall stands midway between two knots, so the knots see less of it than the path."""
    times = np.array([1.9, 2.1])  # in between the knots at 1.8, 2.0, 2.2
    plan = rest_planner(np.array([[2.0]]))
    x = 2.0 - 0.25 * times[0] ** 2
    episodes = rollout(vector(WALLED_INTEGRATOR, 1), TrackingPolicy(WALLED_INTEGRATOR, rest_planner), [[2.0, x]])
    nearest_knot = np.abs(plan.states[0, :, 0] - x).min()
    np.testing.assert_allclose(episodes.knot_violation, 0.1 - nearest_knot, atol=1e-4)
    assert 0.1 - 0.011 <= episodes.violation[0] <= 0.1
    assert episodes.knot_violation[0] < episodes.violation[0]


def test_violations_of_problems_without_constraints_are_zero():
    watch = Violations(DOUBLE_INTEGRATOR, 0.1, np.zeros((2, 2)), np.zeros((2, 0)), np.array([0.1, np.nan]))
    watch.add(1, np.ones(2, bool), np.zeros((2, 2)), np.ones((2, 2)))
    np.testing.assert_array_equal(watch.path, [0.0, 0.0])
    np.testing.assert_array_equal(watch.knots, [0.0, np.nan])


def test_violations_count_while_an_episode_runs():
    """A wall from −0.1 to 0.1 at x = 0; the second episode is over."""
    states = np.array([[1.0, 0.0], [1.0, 0.0]])
    watch = Violations(WALLED_INTEGRATOR, 0.1, states, np.zeros((2, 1)), np.full(2, np.nan))
    watch.add(1, np.array([True, False]), states, np.array([[0.04, 0.0], [0.0, 0.0]]))
    watch.add(2, np.array([True, False]), states, np.array([[0.09, 0.0], [0.0, 0.0]]))
    np.testing.assert_allclose(watch.path, [0.06, 0.0])
    assert np.isnan(watch.knots).all()
