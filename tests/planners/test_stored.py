import numpy as np
import pytest

from moe_policy.planners.stored import StoredPlans
from tests.synthetic import fake_samples

SAMPLES = fake_samples(count=20)
PLANNER = StoredPlans(SAMPLES.parameters, SAMPLES.trajectory)


def test_plans_are_found_by_their_parameters_in_any_order_and_number():
    rows = np.array([7, 3, 3, 19])
    np.testing.assert_array_equal(PLANNER(SAMPLES.parameters[rows]).flat(), SAMPLES.trajectory[rows].flat())
    np.testing.assert_array_equal(PLANNER(SAMPLES.parameters[5]).flat(), SAMPLES.trajectory[5:6].flat())
    assert len(PLANNER(SAMPLES.parameters[:0]).duration) == 0


def test_unknown_parameters_are_an_error():
    p = SAMPLES.parameters[:3].copy()
    p[1, 0] += 1e-12
    with pytest.raises(ValueError, match="no stored plan for 1 of 3 parameters, the first is"):
        PLANNER(p)


def test_zeros_of_either_sign_are_equal():
    p = np.zeros((1, 2))
    planner = StoredPlans(p, SAMPLES.trajectory[:1])
    np.testing.assert_array_equal(planner(-p).flat(), SAMPLES.trajectory[:1].flat())


def test_equal_parameters_have_one_plan():
    twice = np.array([0, 0])
    StoredPlans(SAMPLES.parameters[twice], SAMPLES.trajectory[twice])
    with pytest.raises(ValueError, match=r"got two plans for the parameters .*, rows 0 and 1; expected one"):
        StoredPlans(SAMPLES.parameters[twice], SAMPLES.trajectory[:2])


def test_there_is_a_plan_for_every_parameter():
    with pytest.raises(ValueError, match="expected a plan for each of 3 parameters, got 2 plans"):
        StoredPlans(SAMPLES.parameters[:3], SAMPLES.trajectory[:2])
