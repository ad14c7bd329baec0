"""What the tests of reinforcement learning share: settings that train within seconds, environments and a policy."""

import itertools

import gymnasium as gym
import numpy as np

from moe_policy.rl.actor import Actor, LearnedPolicy
from moe_policy.rl.settings import PPOSettings, SACSettings
from moe_policy.rl.wrappers import (
    FeatureObservation,
    NormalisedAction,
    VectorFeatureObservation,
    VectorNormalisedAction,
)
from ocp_envs.problems.pendulum import PENDULUM

ENV_ID = "PendulumSwingup-v0"
SAC = SACSettings(steps=400, learning_starts=200, gradient_steps=1, n_envs=4, hidden=(8, 16), evaluate_every=200)
PPO = PPOSettings(steps=512, n_envs=8, n_steps=16, batch_size=64, n_epochs=2, hidden=(8, 16), evaluate_every=256)
DEVELOPMENT = np.array([[0.5, 0.5], [3.0, 0.0], [3.2, 0.05], [5.0, -1.0]])


def make_envs(problem, count, **arguments):
    return gym.make_vec(problem.id, num_envs=count, terminate_at_goal=False, autoreset_mode="Disabled", **arguments)


def random_actor(sizes, activation="relu", squash="tanh"):
    source, layers = np.random.default_rng(0), tuple(itertools.pairwise(sizes))
    weights = tuple(source.normal(size=(outputs, inputs)) / np.sqrt(inputs) for inputs, outputs in layers)
    return Actor(weights, tuple(source.normal(size=outputs) for _, outputs in layers), activation, squash)


def random_policy(**arguments):
    return LearnedPolicy(PENDULUM, random_actor([3, 8, 1]), period=0.1, **arguments)


def observations(count, seed=0):
    box = PENDULUM.system.state
    return box.draw(np.random.default_rng(seed), count).astype(np.float32)


def wrapped(**arguments):
    return NormalisedAction(FeatureObservation(gym.make(ENV_ID, **arguments)))


def wrapped_vector(num_envs, autoreset_mode="Disabled", **arguments):
    envs = gym.make_vec(ENV_ID, num_envs=num_envs, autoreset_mode=autoreset_mode, **arguments)
    return VectorNormalisedAction(VectorFeatureObservation(envs))


def obstacle_envs(count):
    return gym.make_vec(
        "QuadcopterObstacle-v0", num_envs=count, vectorization_mode="vector_entry_point", autoreset_mode="Disabled"
    )
