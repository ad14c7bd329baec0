"""The arguments of the environments: in the signature, validated, and refused with an answer."""

from __future__ import annotations

import dataclasses
import inspect
import re

import gymnasium as gym
import numpy as np
import pytest

import ocp_envs
from ocp_envs.envs.env import Env
from ocp_envs.envs.options import EnvOptions
from ocp_envs.envs.simulation import Simulator
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.system import Box, Coordinate


@pytest.mark.parametrize("environment", [Env, VectorEnv])
def test_the_signature_shows_every_argument_with_the_default_of_the_options(environment):
    parameters = inspect.signature(environment).parameters
    shown = {name: p.default for name, p in parameters.items() if p.kind is p.KEYWORD_ONLY}
    expected = {f.name: f.default for f in dataclasses.fields(EnvOptions) if f.name != "problem"}
    assert shown == expected
    for name in shown:
        assert re.search(rf"\b{name}\b", environment.__doc__)


@pytest.mark.parametrize("environment", [Env, VectorEnv])
def test_every_argument_reaches_the_options(environment):
    arguments = {
        "dt": 0.05,
        "terminate_at_goal": False,
        "time_limit": 3.0,
        "max_episode_steps": 9,
        "constants": {"mass": 2.0},
        "delay": 2,
    }
    arguments |= {"disturbance": [0.1, 0.2], "observation_noise": [0.3, 0.4], "render_mode": "rgb_array"}
    options = environment(PENDULUM, **arguments).options
    for name, value in arguments.items():
        np.testing.assert_array_equal(getattr(options, name), value)
    assert options.simulator.problem.system.constants["mass"] == 2.0


@pytest.mark.parametrize(
    "make",
    [
        lambda **arguments: Env(PENDULUM, **arguments),
        lambda **arguments: VectorEnv(PENDULUM, 2, **arguments),
        lambda **arguments: gym.make("PendulumSwingup-v0", **arguments),
        lambda **arguments: gym.make_vec("PendulumSwingup-v0", num_envs=2, **arguments),
    ],
    ids=["Env", "VectorEnv", "make", "make_vec"],
)
def test_a_mistyped_argument_is_answered_with_the_nearest_and_all_that_are_accepted(make):
    with pytest.raises(
        TypeError, match=r"unknown argument 'dely'; did you mean 'delay'\? accepted are \['problem',.*'dt'"
    ):
        make(dely=2)
    with pytest.raises(TypeError, match="did you mean 'terminate_at_goal'"):
        make(terminate_on_goal=False)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"dt": 0.0}, "dt must be a positive"),
        ({"time_limit": -1}, "time_limit"),
        ({"constants": {"mas": 1.0}}, "its constants are"),
        ({"disturbance": [1.0, 1.0, 1.0]}, "2 \\(theta, omega\\)"),
        ({"observation_noise": -0.1}, "standard deviations"),
        ({"delay": 1.5}, "delay: expected a whole number"),
        ({"render_mode": "ansi"}, "render_mode must be"),
    ],
)
def test_refuses_bad_arguments(arguments, match):
    with pytest.raises((TypeError, ValueError), match=match):
        Env(PENDULUM, **arguments)


@pytest.mark.parametrize("make", [Env, lambda problem, **options: VectorEnv(problem, 2, **options)])
def test_a_constant_that_is_a_parameter_is_refused(make):
    mass = Coordinate("mass", 0.5, 2.0, "kg")
    problem = dataclasses.replace(PENDULUM, parameters=Box((*PENDULUM.parameters.coordinates, mass)))
    with pytest.raises(ValueError, match=r"the constants \['mass'\] are parameters of this problem"):
        make(problem, constants={"mass": 4.0})


def test_unknown_problem_names_the_nearest():
    with pytest.raises(ocp_envs.UnknownProblemError, match="PendulumSwingup-v0"):
        Env("PendulumSwngup-v0")


def test_mismatch_changes_the_plant_and_not_the_problem():
    env = Env(PENDULUM, constants={"mass": 2.0})
    assert env.problem is PENDULUM
    start, u = [1.0, 0.0], np.array([[1.0]])
    env.reset(options={"parameters": start})
    env.step(u[0])
    expected = Simulator(PENDULUM.with_constants(mass=2.0), 0.02).advance([start], u, np.zeros((1, 0)))
    np.testing.assert_array_equal(env.state, expected.states[0])
