"""Curves over seeds."""

import numpy as np

from moe_policy.experiments.learner_budgets import Curve, band, over_seeds
from moe_policy.rl.settings import PPOSettings
from tests.experiments.learner_records import training


def line(begin, end, step, slope):
    steps = list(range(begin, end + 1, step))
    return steps, [slope * s for s in steps]


def test_straight_curves_stay_straight_on_common_points():
    points, values = over_seeds([line(10, 100, 10, 1.0), line(15, 90, 25, 2.0)])
    assert points[0] >= 15
    assert points[-1] == 90 or points[-1] == 100
    np.testing.assert_allclose(values[0], points)
    np.testing.assert_allclose(values[1], 2 * np.minimum(points, 90))  # it ended there and keeps its value


def test_equal_points_are_kept_as_they_are():
    curves = [line(10, 50, 10, slope) for slope in (1.0, 5.0, 2.0)]
    points, values = over_seeds(curves)
    np.testing.assert_array_equal(points, curves[0][0])
    np.testing.assert_array_equal(values, [curve[1] for curve in curves])
    np.testing.assert_allclose(band(values), np.outer([1.0, 2.0, 5.0], points))


def test_what_was_not_kept_is_left_out():
    whole, late, none = line(10, 40, 10, 1.0), line(10, 40, 10, 3.0), line(10, 40, 10, 1.0)
    late[1][:2] = [None, None]
    none[1][:] = [None] * 4
    _, values = over_seeds([whole, late, none])
    assert values.shape == (2, 4)
    np.testing.assert_array_equal(np.isnan(values[1]), [True, True, False, False])
    np.testing.assert_array_equal(band(values)[1], [10, 20, 60, 80])
    assert over_seeds([none])[0].size == 0


def test_the_curve_of_a_run_counts_fractions_and_has_none_for_what_was_not_kept():
    curve = Curve.of(training(PPOSettings(steps=200, seed=3), [25, 50]).run)
    assert (curve.seed, curve.steps, curve.seconds) == (3, (100, 200), (2.0, 4.0))
    assert curve.success == (0.5, 1.0)
    assert curve.cost_ratio == (None, None)
