from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import SingleNetwork
from moe_policy.planners.prediction_error import standardised_error, validation_error
from moe_policy.planners.scaling import Standardizer
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.trajectory import Trajectory
from tests.synthetic import fake_samples

SAMPLES = fake_samples(count=20)


def test_the_validation_error_of_a_known_offset():
    optimal = SAMPLES.trajectory
    moved = dataclasses.replace(optimal, states=optimal.states + 0.5, duration=optimal.duration + 3.0)
    error = validation_error(lambda p: moved, SAMPLES.parameters, optimal)
    assert error == pytest.approx((50 * 0.5**2 / 2 + 1 * (3.0 - 0.5)) / 75)


def test_a_plan_that_failed_has_no_validation_error():
    failed = Trajectory.from_flat(np.full((20, 75), np.nan), PENDULUM.knots, 2, 1)
    assert np.isnan(validation_error(lambda p: failed, SAMPLES.parameters, SAMPLES.trajectory))


def test_the_standardised_error_is_in_deviations_of_the_training_split():
    """A network that predicts zero is off by (y − mean) / std everywhere."""
    outputs = Standardizer(SAMPLES.trajectory.flat()[0] + 3.0, np.full(75, 2.0))
    planner = NetworkPlanner(
        PENDULUM,
        "zero",
        SingleNetwork((np.zeros((75, 2)),), (np.zeros(75),)),
        Standardizer(np.zeros(2), np.ones(2)),
        outputs,
    )
    error = standardised_error(planner, SAMPLES.parameters[:1], SAMPLES.trajectory[:1])
    assert error == pytest.approx(1.5 - 0.5)
    wanted = torch.nn.functional.smooth_l1_loss(
        torch.zeros(20, 75, dtype=torch.float64), torch.from_numpy(outputs.scale(SAMPLES.trajectory.flat()))
    )
    assert standardised_error(planner, SAMPLES.parameters, SAMPLES.trajectory) == pytest.approx(float(wanted))


def test_as_many_trajectories_as_plans_are_compared():
    with pytest.raises(ValueError, match="as many trajectories"):
        validation_error(lambda p: SAMPLES.trajectory[:3], SAMPLES.parameters[:3], SAMPLES.trajectory)
