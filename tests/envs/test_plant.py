"""The plant: delay, disturbance and noise of rows that move and rows that do not."""

from __future__ import annotations

import numpy as np
import pytest

from ocp_envs.envs.env import Env
from ocp_envs.envs.options import EnvOptions
from ocp_envs.envs.plant import Plant
from ocp_envs.envs.simulation import Simulator
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from tests.small_problems import DOUBLE_INTEGRATOR

P = np.array([[0.5, 0.0], [1.0, 0.5], [2.0, -0.5]])
ROWS = np.arange(3)


def ones(rows):
    return np.ones((len(rows), 2))


def plant(**imperfections):
    made = Plant(EnvOptions(PENDULUM, **imperfections), 3)
    made.begin(ROWS, P)
    return made


def test_rows_that_stand_still_keep_their_state():
    made = plant(disturbance=0.3)
    made.advance(np.ones((3, 1)), np.array([0, 2]), ones)
    expected = Simulator(PENDULUM, 0.02).advance(P, np.ones((3, 1)), np.zeros((3, 0)), np.full((3, 2), 0.3)).states
    expected[1] = P[1]
    np.testing.assert_array_equal(made.step.state, expected)


def test_an_episode_that_begins_clears_the_delayed_controls_of_its_row_alone():
    made = plant(delay=2)
    acted = []
    for k in range(5):
        if k == 3:
            made.begin(np.array([1]), P[1:2])
        made.advance(np.full((3, 1), 0.1 * (k + 1)), ROWS, ones)
        acted.append(made.step.control[:, 0].copy())
    goal = PENDULUM.goal.control[0]
    np.testing.assert_allclose(np.array(acted)[:, 0], [goal, goal, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.array(acted)[:, 1], [goal, goal, 0.1, goal, goal])


def test_controls_given_do_not_change_later_with_the_array():
    made = plant(delay=1)
    controls = np.full((3, 1), 0.7)
    made.advance(controls, ROWS, ones)
    controls[:] = -1.0
    made.advance(controls, ROWS, ones)
    np.testing.assert_array_equal(made.step.control, 0.7)


def test_noise_is_added_to_the_rows_named_and_clipped_to_the_operating_box():
    made = plant(observation_noise=[0.25, 100.0])
    measured = made.measure(np.array([0, 2]), ones)
    np.testing.assert_array_equal(measured[:, 0], P[[0, 2], 0] + 0.25)
    np.testing.assert_array_equal(measured[:, 1], PENDULUM.system.state.upper[1])
    np.testing.assert_array_equal(made.step.state, P)


@pytest.mark.parametrize("change", [[0.5, -0.2], [[0.5, -0.2], [0.0, 0.1], [-100.0, 0.0]]])
def test_a_push_moves_the_true_state_within_its_box(change):
    envs = VectorEnv(DOUBLE_INTEGRATOR, 3)
    envs.reset(seed=0)
    before, box = envs.state, DOUBLE_INTEGRATOR.system.state
    envs.push(change)
    np.testing.assert_array_equal(envs.state, np.clip(before + np.array(change), box.lower, box.upper))
    single = Env(DOUBLE_INTEGRATOR)
    single.reset(seed=0)
    before = single.state
    single.push([0.5, -0.2])
    np.testing.assert_array_equal(single.state, before + np.array([0.5, -0.2]))


@pytest.mark.parametrize("change", [[0.5], [[0.5, 0.1]], [np.nan, 0.0]])
def test_a_push_is_a_finite_change_of_the_state(change):
    with pytest.raises(ValueError, match="change must be finite numbers for x, v, of the shape"):
        VectorEnv(DOUBLE_INTEGRATOR, 3).push(change)
