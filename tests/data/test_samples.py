from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import fake_samples, flights


def test_images_begin_at_their_parameters_and_are_their_own_inverse():
    samples = flights(10)
    both = samples.with_images()
    assert len(both) == 20
    np.testing.assert_array_equal(both.parameters[:10], samples.parameters)
    starts, _ = samples.problem.start(both.parameters)
    np.testing.assert_allclose(both.trajectory.states[:, 0], starts, atol=1e-9)
    back = both[10:].with_images()[10:]
    np.testing.assert_allclose(back.parameters, samples.parameters, atol=1e-12)
    np.testing.assert_allclose(back.trajectory.flat(), samples.trajectory.flat(), atol=1e-12)
    assert both.index.tolist() == [*range(10), *range(10)]


def test_images_have_the_clearance_of_their_originals():
    both = flights(10).with_images()
    problem = both.problem
    clearance = problem.functions.clearances()
    middle = both.trajectory.states[:, problem.knots // 2]
    values = clearance(middle, problem.start(both.parameters)[1])[0]
    np.testing.assert_allclose(values[:10], values[10:], atol=1e-9)


def test_samples_of_a_problem_without_symmetry_have_no_images():
    with pytest.raises(ValueError, match="declares no symmetry"):
        fake_samples(5).with_images()
