"""What planners return is checked wherever they are called: a planner may be any function."""

import numpy as np
import pytest

import moe_policy
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from tests.synthetic import fake_samples

SAMPLES = fake_samples(2)
P = SAMPLES.parameters
SPHERE = QUADCOPTER_OBSTACLE.parameters.centre[None]

#: What calls a planner with P, or with parameters of the quadcopter.
CALLS = {
    "policy": lambda planner: moe_policy.TrackingPolicy(PENDULUM, planner).start(P),
    "symmetrised": lambda planner: moe_policy.Symmetrised(QUADCOPTER_OBSTACLE, planner)(SPHERE),
    "margin": lambda planner: moe_policy.WithMargin(QUADCOPTER_OBSTACLE, planner, "radius", 0.1)(SPHERE),
    "repaired": lambda planner: moe_policy.Repaired(planner, problem=PENDULUM)(P),
    "checked": lambda planner: moe_policy.Checked(planner, problem=PENDULUM)(P),
    "guesser": lambda planner: moe_policy.SolverPlanner(PENDULUM, guessers=[planner])(P),
    "error": lambda planner: moe_policy.validation_error(planner, P, SAMPLES.trajectory),
}
each_call = pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)


@each_call
@pytest.mark.parametrize("plans", [None, np.zeros((2, 75)), SAMPLES])
def test_plans_are_trajectories(call, plans):
    with pytest.raises(TypeError, match=rf"expected a Trajectory of \d plans from .*, got {type(plans).__name__}"):
        call(lambda p: plans)


@each_call
def test_there_is_a_plan_for_each_row(call):
    with pytest.raises(ValueError, match=r"expected \d plans from .*, one for each row, got 0"):
        call(lambda p: SAMPLES.trajectory[:0])
