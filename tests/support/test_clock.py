"""Durations as numbers of time steps."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from ocp_envs.support.clock import TOLERANCE, count_steps


@pytest.mark.parametrize("step", [0.001, 0.02, 0.05, 0.1, 0.3, 1 / 3])
def test_multiples_of_the_step_are_counted_exactly_however_they_round(step):
    n = np.arange(100_000)
    products = n * step
    np.testing.assert_array_equal(count_steps(products, step), n)
    np.testing.assert_array_equal(count_steps(np.nextafter(products, np.inf), step), n)
    np.testing.assert_array_equal(count_steps(np.cumsum(np.full(1000, step)), step), n[1:1001])


def test_quotients_that_round_up_or_down_do_not_change_the_count():
    assert 2.1 / 0.3 > 7
    assert 0.3 / 0.1 < 3
    pairs = [(2.1, 0.3), (0.3, 0.1), (0.7, 0.1), (0.6, 0.2), (20.0, 0.02), (0.1, 0.02), (8.0, 0.02)]
    for duration, step in pairs:
        exact = Fraction(str(duration)) / Fraction(str(step))
        assert exact.denominator == 1
        assert count_steps(duration, step) == exact


def test_a_step_that_is_only_begun_counts_beyond_the_tolerance():
    dt = 0.02
    excess = np.array([0.0, 0.5, 2.0, 1e3]) * TOLERANCE
    np.testing.assert_array_equal(count_steps((5 + excess) * dt, dt), [5, 5, 6, 6])
    np.testing.assert_array_equal(count_steps((5 - excess) * dt, dt), 5)


def test_shapes_and_types():
    assert count_steps(0.0, 0.1) == 0
    counts = count_steps(np.full((2, 3), 0.25), 0.1)
    assert counts.shape == (2, 3)
    assert counts.dtype == np.int64
