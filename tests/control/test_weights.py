"""Weights of tracking."""

import numpy as np
import pytest

from moe_policy.control.weights import TrackingWeights
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER


def test_weights_are_validated():
    with pytest.raises(ValueError, match="positive"):
        TrackingWeights([1.0], [0.0])
    with pytest.raises(ValueError, match="not negative"):
        TrackingWeights([-1.0], [1.0])


def test_the_weights_of_controls_grow_near_their_bounds():
    box = QUADCOPTER.system.control
    weights = TrackingWeights.uniform(QUADCOPTER, 1.0, 3.0, authority=0.1)
    middle, near, at = box.centre, box.lower + 0.8, box.upper
    found = weights.control_at(np.stack([middle, near, at])[None], box)
    np.testing.assert_allclose(found[0], np.outer([3.0, 3.0 / 0.4**2, 3.0 / 0.1**2], np.ones(4)))
    constant = TrackingWeights.uniform(QUADCOPTER, 1.0, 3.0)
    np.testing.assert_array_equal(constant.control_at(np.stack([middle, at])[None], box), 3.0)


@pytest.mark.parametrize("authority", [0.0, 1.5, np.nan])
def test_the_control_authority_lies_between_nothing_and_that_of_the_centre(authority):
    with pytest.raises(ValueError, match="authority"):
        TrackingWeights.uniform(PENDULUM, authority=authority)
