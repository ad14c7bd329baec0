"""Terminal regulation after another policy."""

from types import SimpleNamespace

import numpy as np

from moe_policy.control.stabiliser import Stabilised, Stabiliser
from ocp_envs.problems.pendulum import PENDULUM


def test_stabilised_hands_over_once_and_forgets_at_a_new_episode():
    inner = SimpleNamespace(
        predict=lambda o, state, episode_start, deterministic: (np.full((len(o), 1), 0.9), (state or 0) + 1)
    )
    policy, holder = Stabilised(inner, PENDULUM), Stabiliser(PENDULUM)
    away, near = np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([[1.0, 0.0], [np.pi + 0.05, 0.0]])
    controls, state = policy.predict(away, None, np.ones(2, bool))
    np.testing.assert_allclose(controls, [[0.9], [0.9]])
    controls, state = policy.predict(near, state, np.zeros(2, bool))
    np.testing.assert_allclose(controls, [[0.9], holder.predict(near)[0][1]])
    controls, state = policy.predict(away, state, np.zeros(2, bool))
    np.testing.assert_allclose(controls, [[0.9], holder.predict(away)[0][1]])
    controls, state = policy.predict(away, state, np.array([False, True]))
    np.testing.assert_allclose(controls, [[0.9], [0.9]])
    assert state.inner.inner == 4
