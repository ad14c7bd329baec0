from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from moe_policy.planners.nearest import NearestPlanner
from ocp_envs.problems.pendulum import PENDULUM

BOX = PENDULUM.parameters


def test_the_plan_is_that_of_the_nearest_parameter_by_search(planners, samples_of_three_modes):
    nearest, samples = planners["nearest"], samples_of_three_modes
    p = BOX.draw(np.random.default_rng(1), 40)
    distance = np.linalg.norm((p[:, None] - samples.parameters) / BOX.width, axis=2)
    np.testing.assert_array_equal(nearest.neighbours(p, 4), distance.argsort(axis=1)[:, :4])
    np.testing.assert_array_equal(nearest(p).flat(), samples.trajectory.flat()[distance.argmin(axis=1)])


@pytest.mark.parametrize("k", [0, 151])
def test_there_are_no_more_neighbours_than_samples(planners, k):
    with pytest.raises(ValueError, match="1 … 150"):
        planners["nearest"].neighbours([0.0, 0.0], k)


def test_something_is_nearest_however_far_away_it_is(planners):
    assert planners["nearest"]([[1e308, -1e308], [0.0, 1e200]]).finite.all()


def test_what_is_stored_can_be_learnt_from(planners, samples_of_three_modes):
    samples = planners["nearest"].samples()
    np.testing.assert_array_equal(samples.parameters, samples_of_three_modes.parameters)
    np.testing.assert_array_equal(samples.mode, samples_of_three_modes.mode)


def test_stored_values_are_counted(planners):
    assert planners["nearest"].parameters_active == 2 + 75
    assert planners["nearest"].parameters_total == 150 * (2 + 75)


def test_rounding_moves_no_parameter_out_of_its_box(planners):
    corners = np.array([[0.0, -2.0], [2 * np.pi, 2.0], [0.1, 0.3]])
    samples = planners["nearest"].samples()[:3]
    rounded = NearestPlanner(dataclasses.replace(samples, parameters=corners)).rounded()
    assert BOX.contains(rounded.parameters).all()
    np.testing.assert_allclose(rounded.parameters, corners, rtol=1e-6)
    np.testing.assert_array_equal(rounded.parameters.astype(np.float32), rounded.parameters)
