"""Plants whose physical constants differ between the rows of a vector environment."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import moe_policy
from ocp_envs import Env, VectorEnv
from tests.small_problems import DOUBLE_INTEGRATOR

MASSES = np.array([0.5, 1.0, 2.0])
P = np.array([[1.0, 0.0], [1.0, 0.0], [-2.0, 0.5]])


def one(mass, p, steps=5):
    env = Env(DOUBLE_INTEGRATOR, constants={"mass": mass})
    env.reset(options={"parameters": p})
    return [env.step([0.3])[:2] for _ in range(steps)]


@pytest.mark.parametrize("carry", [lambda env: env, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_each_row_is_the_plant_with_its_own_constant(carry):
    envs = VectorEnv(DOUBLE_INTEGRATOR, 3, constants={"mass": MASSES})
    envs.reset(options={"parameters": P})
    envs = carry(envs)
    steps = [envs.step(np.full((3, 1), 0.3))[:2] for _ in range(5)]
    for row, mass in enumerate(MASSES):
        for (observed, rewards), (observation, reward) in zip(steps, one(mass, P[row]), strict=True):
            np.testing.assert_array_equal(observed[row], observation)
            assert rewards[row] == reward
    assert envs.context.shape == (3, 0)
    assert envs.observation_space.shape == (3, 2)


def test_equal_numbers_are_those_of_one_plant():
    envs = VectorEnv(DOUBLE_INTEGRATOR, 2, constants={"mass": [2.0, 2.0]})
    same = VectorEnv(DOUBLE_INTEGRATOR, 2, constants={"mass": 2.0})
    for each in (envs, same):
        each.reset(options={"parameters": P[:2]})
    np.testing.assert_array_equal(envs.step(np.ones((2, 1)))[0], same.step(np.ones((2, 1)))[0])


def test_a_rollout_meets_a_different_plant_in_each_row():
    """Tracking the plan of the nominal mass, the final error grows with the mass."""
    policy = moe_policy.TrackingPolicy(DOUBLE_INTEGRATOR, moe_policy.SolverPlanner(DOUBLE_INTEGRATOR))
    envs = moe_policy.environments(DOUBLE_INTEGRATOR, 3, constants={"mass": [1.0, 1.05, 1.5]})
    episodes = moe_policy.rollout(envs, policy, np.tile([4.0, 0.0], (3, 1)))
    assert (np.diff(episodes.plan_end_error) > 0).all()


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ({"mass": [1.0, 2.0]}, r"one for each of 3 environments, got the shape \(2,\)"),
        ({"mass": [[1.0], [2.0], [3.0]]}, "a finite number, or one for each environment"),
        ({"mass": [1.0, np.nan, 1.0]}, "a finite number, or one for each environment"),
        ({"weight": [1.0, 2.0, 3.0]}, r"has no constant \['weight'\]"),
    ],
)
def test_constants_that_do_not_fit_are_refused(constants, message):
    with pytest.raises(ValueError, match=message):
        VectorEnv(DOUBLE_INTEGRATOR, 3, constants=constants)


def test_one_environment_has_one_number():
    with pytest.raises(ValueError, match="one for each of 1 environments"):
        Env(DOUBLE_INTEGRATOR, constants={"mass": MASSES})
