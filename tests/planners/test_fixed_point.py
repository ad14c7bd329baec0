from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moe_policy.planners import fixed_point
from ocp_envs.trajectory import Trajectory


def trajectory(seed, scale=1.0, size=7):
    rng = np.random.default_rng(seed)
    scales = scale * 10.0 ** rng.integers(-6, 6, 3)
    return Trajectory(scales * rng.normal(size=(size, 5, 3)), rng.normal(size=(size, 4, 1)), 1 + rng.random(size))


@given(st.integers(0, 1000), st.sampled_from([1e-12, 1.0, 1e12]), st.integers(0, 4))
def test_rounded_trajectories_are_packed_without_loss(seed, scale, size):
    rounded = fixed_point.rounded(trajectory(seed, scale, size))
    tensors = fixed_point.packed(rounded)
    np.testing.assert_array_equal(fixed_point.unpacked(tensors).flat(), rounded.flat())


def test_rounding_changes_little():
    exact = trajectory(0, size=500)
    for name in ("states", "controls"):
        before, after = getattr(exact, name), getattr(fixed_point.rounded(exact), name)
        assert (np.abs(after - before) <= np.ptp(before, axis=(0, 1)) / 5792).all()  # 0 is within the range


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_rounded_or_not_finite_is_not_packed(value):
    exact = trajectory(2)
    assert fixed_point.packed(exact) is None
    states = np.array(fixed_point.rounded(exact).states)
    states[0, 0, 0] = value
    assert fixed_point.packed(Trajectory(states, exact.controls, exact.duration)) is None


def test_constant_coordinates_are_rounded_as_well():
    constant = Trajectory(np.zeros((3, 4, 2)), np.full((3, 3, 1), 0.3), np.ones(3))
    rounded = fixed_point.rounded(constant)
    np.testing.assert_allclose(rounded.flat(), constant.flat(), rtol=0, atol=0.3 / 5792)
