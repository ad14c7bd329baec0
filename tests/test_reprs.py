"""What is looked at in a console fits there."""

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.pendulum import PENDULUM
from tests.closed_loop import PARAMETERS, constant, rest_planner, vector
from tests.learners import random_policy
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.synthetic import fake_samples

NEAREST = moe_policy.NearestPlanner(fake_samples())
SOLUTIONS = ocp_envs.Solutions.empty(DOUBLE_INTEGRATOR, 3)


def database(path):
    return ocp_envs.Database.create(path / "db.zarr", DOUBLE_INTEGRATOR, PARAMETERS)


@pytest.mark.parametrize(
    ("make", "shown"),
    [
        (
            lambda _: moe_policy.TrackingPolicy(PENDULUM, NEAREST),
            "TrackingPolicy('PendulumSwingup-v0', NearestPlanner(",
        ),
        (lambda _: moe_policy.Stabiliser(PENDULUM), "Stabiliser('PendulumSwingup-v0', dt=0.02)"),
        (lambda _: random_policy(), "LearnedPolicy('PendulumSwingup-v0', 'sac', layers 3-8-1, 0.1 s, dt=0.02)"),
        (lambda _: NEAREST, "trajectories)"),
        (lambda _: moe_policy.load(PENDULUM, "moe-custom"), "mixture of 3 experts"),
        (lambda _: moe_policy.Repaired(NEAREST, 3), "trajectories), 3, margin=0)"),
        (lambda _: moe_policy.BestOf(moe_policy.Candidates(NEAREST)), "trajectories), 1 plans for each instance))"),
        (lambda _: moe_policy.load(PENDULUM, "checked"), "2 candidates, Repair(iterations=10, rounds=3, margin=0.0)"),
        (
            lambda _: moe_policy.load(PENDULUM, "checked").check(np.zeros((0, 2))),
            "<CheckedPlans of 0: 0 verified; 0 chosen, 0 repaired, 0 solved, 0 abstained>",
        ),
        (lambda _: ocp_envs.Env(PENDULUM), "Env('PendulumSwingup-v0', dt=0.02, time_limit=20.0)"),
        (lambda _: environments(PENDULUM, 7), "VectorEnv('PendulumSwingup-v0', num_envs=7, dt=0.02, time_limit=20.0)"),
        (lambda _: rollout(vector(DOUBLE_INTEGRATOR, 3), constant(0.0), PARAMETERS, horizon=0.1), "<Episodes of 3: "),
        (
            lambda _: rest_planner(PARAMETERS),
            "<Trajectory of 3: states (3, 21, 2), controls (3, 20, 1), duration (3,)>",
        ),
        (lambda _: SOLUTIONS, "trajectory (Trajectory)"),
        (lambda _: ocp_envs.Solution(np.array([0.1, 2.0]), SOLUTIONS, ocp_envs.Status.EMPTY), "EMPTY, no trajectory"),
        (database, "of 'DoubleIntegrator-v0': 0 of 3 instances>"),
    ],
)
def test_reprs_take_one_to_three_lines_and_say_what_it_is(tmp_path, make, shown):
    text = repr(make(tmp_path))
    assert shown in text
    assert len(text) <= 3 * 120
    assert len(text.splitlines()) <= 3
