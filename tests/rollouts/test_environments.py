"""Vector environments as rollouts need them."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import ocp_envs
from moe_policy.control.stabiliser import Stabiliser
from moe_policy.control.weights import TrackingWeights
from moe_policy.rollouts.environments import base_of, environments
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.pendulum import PENDULUM


def test_a_problem_need_not_be_registered():
    problem = replace(PENDULUM, id="NeverRegistered-v0")
    envs = environments(problem, 3)
    assert envs.problem is problem
    p, weights = np.array([[0.1, 0.0], [1.0, 0.5], [2.0, -0.5]]), TrackingWeights.uniform(PENDULUM)
    ours, registered = (
        rollout(each, Stabiliser(each.problem, weights=weights), p, record=True)
        for each in (envs, environments(PENDULUM, 3))
    )
    np.testing.assert_array_equal(ours.states, registered.states)


def test_environments_neither_restart_nor_end_at_the_goal_unless_told():
    envs = environments(PENDULUM, 2, 0.05, time_limit=4.0)
    assert (envs.dt, envs.num_envs, envs.options.time_limit) == (0.05, 2, 4.0)
    assert envs.autoreset_mode is AutoresetMode.DISABLED
    assert not envs.options.terminate_at_goal
    assert environments(PENDULUM, 2, terminate_at_goal=True).options.terminate_at_goal


def test_the_base_is_found_inside_wrappers_and_others_are_refused():
    envs = environments(PENDULUM, 2)
    assert base_of(gym.wrappers.vector.ClipReward(envs, -1.0, 0.0)) is envs
    assert isinstance(base_of(envs), ocp_envs.VectorEnv)
    with pytest.raises(TypeError, match="expected a vector environment of ocp_envs, wrapped or not; got SyncVectorEnv"):
        base_of(gym.make_vec("Pendulum-v1", num_envs=1, vectorization_mode="sync"))
