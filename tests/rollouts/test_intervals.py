"""Intervals against closed forms, counts and SciPy."""

import json
import math

import numpy as np
import pytest
from scipy import stats

from moe_policy.rollouts.intervals import Estimate, Mean, Proportion, Spread, disjoint


@pytest.mark.parametrize(("count", "total"), [(0, 10), (7, 10), (998, 1000), (1000, 1000)])
def test_wilson_interval_is_the_root_of_its_quadratic(count, total):
    z = 1.959963984540054
    fraction = count / total
    centre = (fraction + z**2 / (2 * total)) / (1 + z**2 / total)
    half = z / (1 + z**2 / total) * np.sqrt(fraction * (1 - fraction) / total + z**2 / (4 * total**2))
    np.testing.assert_allclose(Proportion(count, total).interval, [centre - half, centre + half], atol=1e-12)


@pytest.mark.parametrize(("count", "total"), [(-1, 3), (4, 3), (0, 0)])
def test_impossible_proportions_are_refused(count, total):
    with pytest.raises(ValueError, match="expected"):
        Proportion(count, total)


def test_means_have_students_interval():
    values = np.array([0.1, 0.3, np.nan, 0.2, 0.6])
    found, finite = Mean.of(values), values[np.isfinite(values)]
    low, high = stats.t.interval(0.95, 3, finite.mean(), stats.sem(finite))
    assert low < 0
    np.testing.assert_allclose([found.mean, *found.interval], [0.3, 0.0, high])
    assert found.total == 4
    assert Mean.of([0.2]).interval == (0.0, 0.4)
    assert Mean.of([np.nan]) is None


def test_minimum_and_maximum_enclose_the_median_as_often_as_they_say():
    rng = np.random.default_rng(0)
    for n in (2, 3, 5):
        draws = rng.exponential(size=(20_000, n))
        found = np.mean((draws.min(axis=1) < math.log(2)) & (draws.max(axis=1) > math.log(2)))
        assert found == pytest.approx(Spread.of(draws[0]).coverage, abs=0.01)


def test_the_mean_over_seeds_has_scipys_interval_cut_at_its_bounds():
    values = (0.2, 0.5, 0.35, 0.9)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert Spread.of(values).mean_interval == pytest.approx((expected.low, expected.high))
    assert Spread.of((0.99, 1.0), (0, 1)).mean_interval[1] == 1.0
    one = Spread.of([0.4])
    assert (one.median, one.minimum, one.maximum, one.mean_interval, one.coverage) == (0.4, 0.4, 0.4, None, 0.0)


@pytest.mark.parametrize("values", [(), (0.1, math.nan)])
def test_a_spread_of_nothing_is_refused(values):
    with pytest.raises(ValueError, match="expected a finite metric"):
        Spread.of(values)


def test_intervals_that_touch_are_not_disjoint():
    def mean(low, high):
        return Mean(0.0, 2, (low, high))

    assert disjoint(mean(0.1, 0.2), mean(0.3, 0.4))
    assert disjoint(mean(0.3, 0.4), mean(0.1, 0.2))
    assert not disjoint(mean(0.1, 0.3), mean(0.3, 0.4))
    assert not disjoint(mean(0.1, 0.9), mean(0.3, 0.4))


VALUES = [Proportion(3, 4), Mean.of([0.1, 0.2]), Spread.of([0.2, 0.3], (0, 1)), Spread.of([0.2])]


@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_every_estimate_is_read_as_it_was_written(value):
    content = json.loads(json.dumps(value.to_json(), allow_nan=False))
    assert type(value).from_json(content) == value
    assert type(value).from_json(content).to_json() == content
    assert isinstance(value, Spread) or Estimate.from_json(content) == value
    for wrong in (content | {"more": 1}, dict(list(content.items())[1:]), [content], content | {"total": "1"}):
        with pytest.raises(ValueError, match="expected an object with the keys"):
            type(value).from_json(wrong)
