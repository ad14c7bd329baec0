import math

import numpy as np
import pytest
from scipy.stats import binom

from moe_policy.rollouts.conformal import coverage_range, least_success, upper_bound


@pytest.mark.parametrize(("count", "level", "rank"), [(99, 0.95, 95), (100, 0.95, 96), (19, 0.95, 19), (9, 0.9, 9)])
def test_the_bound_is_the_value_of_that_rank(count, level, rank):
    values = np.random.default_rng(0).permutation(count) + 1.0
    assert upper_bound(values, level) == rank


def test_too_few_values_or_too_many_failures_have_no_bound():
    assert upper_bound(np.ones(18), 0.95) == math.inf
    assert upper_bound([], 0.95) == math.inf
    values = np.ones(100)
    values[:5] = np.inf
    assert upper_bound(values, 0.95) == math.inf
    values[0] = 1.0
    assert upper_bound(values, 0.95) == 1.0
    assert coverage_range(18) == (1.0, 1.0)


@pytest.mark.parametrize("draw", ["standard_normal", "standard_exponential", "standard_cauchy"])
def test_fresh_values_are_covered_as_promised_whatever_the_distribution(draw):
    rng, level, count = np.random.default_rng(1), 0.9, 50
    values = getattr(rng, draw)((4000, count))
    fresh = getattr(rng, draw)(4000)
    covered = np.array([upper_bound(row, level) for row in values]) >= fresh
    assert level - 0.015 < covered.mean() < level + 2 / (count + 1) + 0.015


def test_the_coverage_of_one_calibration_is_in_its_range():
    rng, level, count = np.random.default_rng(2), 0.9, 100
    low, high = coverage_range(count, level)
    coverage = np.array([upper_bound(rng.random(count), level) for _ in range(2000)])  # of uniform numbers
    assert ((low < coverage) & (coverage < high)).mean() == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize(("count", "total"), [(100, 100), (95, 100), (1, 20)])
def test_with_the_least_success_so_many_would_be_rare(count, total):
    """The exact binomial distribution: with that probability, as many successes happen in one case of twenty."""
    least = least_success(np.arange(total) < count)
    assert binom.sf(count - 1, total, least) == pytest.approx(0.05)


def test_no_success_at_all_has_no_lower_bound():
    assert least_success(np.zeros(10, bool)) == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: upper_bound([1.0, np.nan]), "values: expected"),
        (lambda: upper_bound([[1.0]]), "values: expected"),
        (lambda: upper_bound([1.0], 1.0), "level: expected a number in"),
        (lambda: coverage_range(10, confidence=0.0), "confidence: expected a number in"),
        (lambda: least_success(np.zeros(0, bool)), "flags: expected at least one"),
        (lambda: least_success(np.ones(3, bool), 2.0), "confidence: expected a number in"),
    ],
)
def test_impossible_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
