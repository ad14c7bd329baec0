from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from moe_policy.planners.scaling import Standardizer

matrices = st.tuples(st.integers(1, 20), st.integers(1, 6)).flatmap(
    lambda shape: arrays(np.float64, shape, elements=st.floats(-1e6, 1e6))
)


@given(matrices)
def test_unscale_inverts_scale(values):
    scaler = Standardizer.fit(values)
    np.testing.assert_allclose(scaler.unscale(scaler.scale(values)), values, rtol=1e-9, atol=1e-6)


@given(matrices)
def test_scaled_columns_have_zero_mean_and_unit_or_tiny_deviation(values):
    scaled = Standardizer.fit(values).scale(values)
    deviation = scaled.std(axis=0)
    moved = values.std(axis=0) >= 1e-3
    np.testing.assert_allclose(scaled[:, moved].mean(axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(deviation[moved], 1, rtol=1e-6)
    assert (deviation[~moved] <= 1e-3 + 1e-9).all()


def test_a_constant_column_is_only_shifted():
    scaler = Standardizer.fit(np.array([[3.0, 1.0], [3.0004, 2.0]]))
    assert scaler.std[0] == 1.0
    assert scaler.std[1] == 0.5


def test_rows_scale_independently_of_their_batch():
    values = np.random.default_rng(0).normal(size=(10, 3))
    scaler = Standardizer.fit(values)
    np.testing.assert_array_equal(scaler.scale(values)[4], scaler.scale(values[4]))


def test_the_scaler_cannot_be_changed():
    mean = np.zeros(2)
    scaler = Standardizer(mean, np.ones(2))
    mean[0] = 5
    assert scaler.mean[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        scaler.std[0] = 2


@pytest.mark.parametrize(
    ("values", "match"),
    [(np.empty((0, 3)), "at least one row"), (np.ones(3), "shape"), (np.array([[1.0], [np.nan]]), "row 1")],
)
def test_fit_refuses_unusable_values(values, match):
    with pytest.raises(ValueError, match=match):
        Standardizer.fit(values)


@pytest.mark.parametrize("std", [[0.0], [-1.0], [np.inf], [np.nan], [1.0, 1.0]])
def test_unusable_deviations_are_refused(std):
    with pytest.raises(ValueError):
        Standardizer([0.0], std)


def test_wrong_number_of_columns_is_named():
    with pytest.raises(ValueError, match="expected 2 columns"):
        Standardizer([0.0, 0.0], [1.0, 1.0]).scale(np.ones((4, 3)))
