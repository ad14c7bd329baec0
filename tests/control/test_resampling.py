"""Resampled plans against integrals and the true motion."""

import numpy as np
import pytest

from moe_policy.control.resampling import mean_controls, states_at
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.support.clock import count_steps
from ocp_envs.trajectory import Trajectory
from tests.plans import DT, random_plan
from tests.small_problems import DOUBLE_INTEGRATOR, rest_to_rest


def test_the_control_steps_of_a_plan_include_the_last_partial_one():
    np.testing.assert_array_equal(count_steps(np.array([0.1, 0.1001, 0.02, 0.3, 8.0]), 0.02), [5, 6, 1, 15, 400])


def test_the_mean_control_is_the_integral_over_each_control_step():
    plan, _ = random_plan(PENDULUM, 3)
    after = np.array([0.7])
    steps = 160
    means = mean_controls(plan, DT, steps, np.tile(after, (len(plan), 1)))
    fine = (np.arange(steps * 4000) + 0.5) * DT / 4000
    for row in range(3):
        interval = np.minimum((fine / plan.step[row]).astype(int), plan.knots - 1)
        held = np.concatenate([plan.controls[row, :, 0], after])[interval]
        np.testing.assert_allclose(means[row, :, 0], held.reshape(steps, -1).mean(axis=1), atol=5e-4)
    total = means.sum(axis=1)[:, 0] * DT
    expected = plan.controls.sum(axis=1)[:, 0] * plan.step + after * (steps * DT - plan.duration)
    np.testing.assert_allclose(total, expected, rtol=1e-12)


def test_hermite_is_exact_where_the_states_are_quadratic_and_the_control_is_discontinuous():
    plan = Trajectory(*rest_to_rest(np.array([2.0, -1.0]), 4.0, 21))
    times = np.linspace(0, 4.0, 173)
    states = states_at(DOUBLE_INTEGRATOR.functions.rate(), plan, np.zeros((2, 0)), times)
    exact = rest_to_rest(np.array([2.0, -1.0]), 4.0, 41)[0]
    np.testing.assert_allclose(states[:, ::43], exact[:, ::10], atol=1e-12)
    force = plan.controls[:, :1, 0]
    late = np.maximum(times - 2, 0)
    np.testing.assert_allclose(states[..., 0], np.array([[2.0], [-1.0]]) + force * (times**2 / 2 - late**2), atol=1e-12)


@pytest.mark.parametrize(("problem", "tolerance"), [(PENDULUM, 1e-5), (QUADCOPTER, 1e-3)])
def test_hermite_follows_the_true_motion_between_knots(problem, tolerance):
    plan, contexts = random_plan(problem, 5, spread=0.01)
    flow = problem.functions.flow(20)
    middle = np.full((len(plan), 1), 0.5) * plan.step[:, None]
    for i in range(0, problem.knots - 1, 5):
        expected, _ = flow(plan.states[:, i], plan.controls[:, i], contexts, middle)
        times = (i + 0.5) * plan.step[:, None]
        states = states_at(problem.functions.rate(), plan, contexts, times)
        np.testing.assert_allclose(
            states[:, 0] / problem.system.state.scale, expected / problem.system.state.scale, atol=tolerance
        )
