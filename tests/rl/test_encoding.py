"""Encodings, and policies that carry theirs."""

import numpy as np
import pytest

from moe_policy import store
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.encoding import Encoding, encoding_of
from moe_policy.rl.features import Features, widths_near_goal
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from tests.learners import random_actor

ENCODING = encoding_of(QUADCOPTER, near_goal=2, stride=0.75, period=0.04)


def test_features_near_the_goal_follow_from_the_goal_ball_and_the_scales():
    widths = widths_near_goal(QUADCOPTER, 2)
    np.testing.assert_allclose(widths[0], 0.1)
    np.testing.assert_allclose(widths[1], np.sqrt(0.1 * QUADCOPTER.system.state.scale))
    state = np.zeros(12)
    state[[0, 8]] = 0.05, 2 * np.pi - 0.1  # a whole turn makes no difference
    features = Features(QUADCOPTER, widths)(state)
    assert features.shape == (13 + 24,)
    np.testing.assert_allclose(features[[13, 25]], np.tanh([0.05 / 0.1, 0.05 / np.sqrt(0.5)]), rtol=1e-6)
    np.testing.assert_allclose(features[21], np.tanh(-1.0), rtol=1e-5)


@pytest.mark.parametrize("problem", [QUADCOPTER, QUADCOPTER_OBSTACLE], ids=lambda p: p.id)
def test_the_space_holds_features_near_the_goal(problem):
    features = Features(problem, widths_near_goal(problem, 3))
    corner = np.concatenate([problem.system.state.upper, problem.context.lower]).astype(np.float32)
    assert features.space.contains(features(corner))
    assert features(np.tile(corner, (2, 3, 1))).shape == (2, 3, features.size)


def test_widths_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"expected positive widths \(n, 12\), got shape \(1, 3\)"):
        Features(QUADCOPTER, np.ones((1, 3)))


def test_a_policy_keeps_its_encoding_in_its_files(tmp_path):
    actor = random_actor([37, 8, 4], "tanh", "clip")
    policy = LearnedPolicy(QUADCOPTER, actor, period=0.04, algorithm="ppo", encoding=ENCODING)
    policy.save(tmp_path / "ppo")
    again = store.load_file(tmp_path / "ppo")
    seen = QUADCOPTER.system.state.draw(np.random.default_rng(0), 20)
    np.testing.assert_allclose(again.controls(seen), policy.controls(seen), atol=1e-6)
    np.testing.assert_allclose(policy.at(0.04).controls(seen), policy.controls(seen))


def test_a_plain_encoding_is_not_stored():
    assert Encoding().tensors == {}
    assert encoding_of(QUADCOPTER, 0, 0.0, 0.04).tensors == {}
    assert sorted(ENCODING.tensors) == ["encoding.centre", "encoding.directions", "encoding.widths"]
