"""Features and actions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ocp_envs
from moe_policy.rl.actions import Actions
from moe_policy.rl.features import Features
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE

CATALOGUE = [*ocp_envs.problems.BENCHMARK]


@given(theta=st.floats(-12, 18), omega=st.floats(-6, 6), turns=st.integers(-2, 2))
def test_features_of_the_pendulum_are_sine_cosine_and_scaled_rate(theta, omega, turns):
    expected = [np.sin(theta), np.cos(theta), omega / 2.0]
    features = Features(PENDULUM)
    np.testing.assert_allclose(features([theta, omega]), expected, atol=1e-6)
    np.testing.assert_allclose(features([[theta + 2 * np.pi * turns, omega]]), [expected], atol=1e-5)


def test_features_scale_states_by_their_size_and_context_by_its_box():
    problem = QUADCOPTER_OBSTACLE
    rng = np.random.default_rng(0)
    state = problem.system.state.draw(rng, 5)
    context = np.array([[-10.0, 0.0, 10.0, 1.0]] * 4 + [[5.0, 5.0, 5.0, 5.0]])
    values = Features(problem)(np.hstack([state, context]))
    assert values.shape == (5, 17)
    np.testing.assert_allclose(values[:, :2], np.stack([np.sin(state[:, 8]), np.cos(state[:, 8])], 1), atol=1e-6)
    np.testing.assert_allclose(values[:, 2:5], state[:, :3] / 5, rtol=1e-6)
    np.testing.assert_allclose(values[:4, -4:], [[-1, 0, 1, -1]] * 4, atol=1e-6)
    np.testing.assert_allclose(values[4, -4:], [0.5, 0.5, 0.5, 1.0], atol=1e-6)


@pytest.mark.parametrize("problem", [*CATALOGUE, QUADCOPTER_OBSTACLE], ids=lambda p: p.id)
def test_the_feature_space_holds_the_features_of_the_corners_of_the_box(problem):
    features = Features(problem)
    for side in ("lower", "upper"):
        corner = np.concatenate([getattr(problem.system.state, side), getattr(problem.context, side)])
        assert features.space.contains(features(corner))
        assert features.space.contains(features(corner.astype(np.float32)))


def test_features_refuse_observations_of_another_size():
    with pytest.raises(ValueError, match=r"expected observations \(\.\.\., 2\), got \(4, 3\)"):
        Features(PENDULUM)(np.zeros((4, 3)))


def test_actions_map_the_ends_and_the_middle_and_clip():
    actions = Actions(QUADCOPTER_OBSTACLE)
    np.testing.assert_allclose(actions.controls([-1, 0, 1, 2]), [0, 2, 4, 4])
    controls = np.random.default_rng(0).uniform(0, 4, (7, 4))
    np.testing.assert_allclose(actions.controls(actions.actions(controls)), controls, atol=1e-12)
