"""Which environments a policy accepts: those of its coordinates and its control period, whatever is around them."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import vector as vector_wrappers

from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.rl.wrappers import FeatureObservation, NormalisedAction, VectorFeatureObservation
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.rollout import rollout
from ocp_envs.envs.env import Env
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from tests.learners import random_policy
from tests.small_problems import DOUBLE_INTEGRATOR

ID = PENDULUM.id
STRONG = dataclasses.replace(
    PENDULUM,
    id="Strong-v0",
    system=dataclasses.replace(
        PENDULUM.system,
        control=dataclasses.replace(
            PENDULUM.system.control,
            coordinates=tuple(dataclasses.replace(c, upper=3.0) for c in PENDULUM.system.control.coordinates),
        ),
    ),
)


def sb3(kind):
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    inner = vec_env.DummyVecEnv([lambda: gym.make(ID)] * 2)
    return {
        "plain": lambda: inner,
        "normalised": lambda: vec_env.VecNormalize(inner),
        "rewards": lambda: vec_env.VecNormalize(inner, norm_obs=False),
    }[kind]()


@pytest.mark.parametrize(
    "make",
    [
        lambda: gym.make(ID),
        lambda: Env(PENDULUM, constants={"mass": 1.3}, disturbance=0.1, delay=1, time_limit=3.0),
        lambda: wrappers.ClipAction(wrappers.DtypeObservation(gym.make(ID), np.float64)),
        lambda: wrappers.NormalizeReward(wrappers.RecordEpisodeStatistics(gym.make(ID, max_episode_steps=9))),
        lambda: wrappers.FlattenObservation(gym.make(ID)),
        lambda: environments(PENDULUM, 2),
        lambda: vector_wrappers.TransformReward(environments(PENDULUM, 2), lambda r: r / 2),
        lambda: gym.make_vec(ID, num_envs=2, vectorization_mode="sync"),
        lambda: sb3("plain"),
        lambda: sb3("rewards"),
        lambda: Env(PENDULUM.with_constants(mass=1.2)),
    ],
)
def test_environments_that_fit_are_accepted(make):
    for policy in (Stabiliser(PENDULUM), random_policy(), Stabilised(random_policy(), PENDULUM)):
        policy.check(make())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: gym.make(ID, dt=0.05), r"got a policy for 0\.02 s in environments of 0\.05 s, expected the same dt"),
        (lambda: gym.make_vec(ID, num_envs=2, dt=0.01), r"in environments of 0\.01 s"),
        (lambda: SyncVectorEnv([lambda: gym.make(ID), lambda: gym.make(ID, dt=0.1)]), r"environments of 0\.1 s"),
        (lambda: Env(QUADCOPTER), r"got Quadcopter-v0 with .*: make a policy for that problem"),
        (lambda: Env(DOUBLE_INTEGRATOR), r"expected an environment with observations \(theta \[rad\]"),
        (lambda: wrappers.RescaleAction(Env(STRONG), -1.0, 1.0), "a wrapper changes the actions"),
        (lambda: NormalisedAction(Env(STRONG)), "a wrapper changes the actions"),
        (lambda: wrappers.NormalizeObservation(gym.make(ID)), "a wrapper changes the observations"),
        (lambda: wrappers.RescaleObservation(gym.make(ID), -1.0, 1.0), "a wrapper changes the observations"),
        (lambda: wrappers.FrameStackObservation(gym.make(ID), 2), "a wrapper changes the observations"),
        (lambda: wrappers.TimeAwareObservation(gym.make(ID)), "a wrapper changes the observations"),
        (lambda: FeatureObservation(gym.make(ID)), "a wrapper changes the observations"),
        (lambda: VectorFeatureObservation(environments(PENDULUM, 2)), "a wrapper changes the observations"),
        (lambda: vector_wrappers.NormalizeObservation(gym.make_vec(ID, num_envs=2)), "changes the observations"),
        (lambda: sb3("normalised"), "expected observations in their units, got those of VecNormalize"),
    ],
)
def test_environments_that_do_not_fit_are_refused_with_the_cure(make, message):
    for policy in (Stabiliser(PENDULUM), random_policy(), Stabilised(random_policy(), PENDULUM)):
        with pytest.raises(ValueError, match=message):
            policy.check(make())


@pytest.mark.parametrize("env", [None, "PendulumSwingup-v0", PENDULUM, lambda: gym.make("Pendulum-v1")])
def test_what_is_no_environment_of_the_library_is_refused(env):
    with pytest.raises(TypeError, match="expected an environment of ocp_envs, single or vector, wrapped or not; got"):
        Stabiliser(PENDULUM).check(env() if callable(env) else env)


def test_a_policy_after_which_the_stabiliser_regulates_is_checked_too():
    with pytest.raises(ValueError, match=r"got a policy for 0\.1 s in environments of 0\.02 s"):
        Stabilised(Stabiliser(PENDULUM, dt=0.1), PENDULUM).check(gym.make(ID))


def test_rollouts_check_the_environments():
    envs = VectorFeatureObservation(environments(PENDULUM, 1))
    with pytest.raises(ValueError, match="a wrapper changes the observations"):
        rollout(envs, Stabiliser(PENDULUM), [[1.0, 0.0]])
    with pytest.raises(ValueError, match="got Quadcopter-v0 with"):
        rollout(environments(QUADCOPTER, 1), Stabiliser(PENDULUM), np.zeros((1, len(QUADCOPTER.parameters))))
