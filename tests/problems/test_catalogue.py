"""Registered problems: known by name here, by value in other processes."""

import copy
import dataclasses
import json
import pickle

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest

import ocp_envs
from ocp_envs import problems
from ocp_envs.envs.env import Env
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM

ID = "Travelling-v0"


def forget():
    problems._catalogue.pop(ID, None)
    gym.registry.pop(ID, None)


@pytest.fixture
def problem():
    mine = dataclasses.replace(PENDULUM, id=ID, cost_rate=lambda x, u, s, c: 2 + u[0] ** 2)
    ocp_envs.register(mine)
    yield mine
    forget()


@pytest.mark.parametrize(
    "make", [Env, lambda p: VectorEnv(p, 2), lambda p: gym.make(p.id), lambda p: gym.make_vec(p.id)]
)
def test_environments_of_a_registered_problem_travel_to_processes_that_do_not_know_it(problem, make):
    env = make(problem)
    env.reset(seed=0)
    pickled = pickle.dumps(env)
    forget()
    again = pickle.loads(pickled)
    action = np.full(again.action_space.shape, 0.5, np.float32)
    np.testing.assert_array_equal(again.step(action)[0], env.step(action)[0])
    assert again.unwrapped.problem.id == ID


def test_a_specification_takes_its_problem_along(problem):
    spec = gym.spec(ID)
    assert json.loads(spec.to_json())["kwargs"] == {"problem": ID}
    assert copy.deepcopy(spec).kwargs == {"problem": ID}
    pickled = cloudpickle.dumps(spec)
    forget()
    env = gym.make(cloudpickle.loads(pickled))
    assert env.unwrapped.problem.id == ID
    assert ID in ocp_envs.names()


def test_problems_of_the_benchmark_travel_by_name():
    assert pickle.loads(pickle.dumps(Env(PENDULUM))).problem is PENDULUM
    assert len(pickle.dumps(gym.spec(PENDULUM.id).kwargs["problem"])) < 200


def test_a_problem_that_is_known_already_is_not_replaced(problem):
    name = pickle.loads(pickle.dumps(gym.spec(ID).kwargs["problem"]))
    assert (name, ocp_envs.load(ID)) == (ID, problem)


@pytest.mark.slow
def test_asynchronous_environments_in_new_processes_know_a_registered_problem(problem):
    envs = gym.make_vec(ID, num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"})
    try:
        assert envs.reset(seed=0)[0].shape == (2, 2)
    finally:
        envs.close()


@pytest.mark.slow
def test_stable_baselines_in_new_processes_gets_a_registered_problem_with_its_specification(problem):
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    spec = gym.spec(ID)
    envs = vec_env.SubprocVecEnv([lambda: gym.make(spec)] * 2, start_method="spawn")
    try:
        assert envs.reset().shape == (2, 2)
    finally:
        envs.close()


def test_a_later_version_takes_the_place_of_an_earlier_one_where_it_is_asked_to(problem):
    later = dataclasses.replace(problem, hold=1.0)
    with pytest.raises(ValueError, match=r"already registered; give yours another id, or replace=True"):
        ocp_envs.register(later)
    ocp_envs.register(later, replace=True)
    assert ocp_envs.load(ID) is later
    assert gym.make(ID).unwrapped.problem is later


def test_a_problem_of_the_benchmark_keeps_its_place():
    with pytest.raises(ValueError, match=r"is already registered; give yours another id$"):
        ocp_envs.register(dataclasses.replace(PENDULUM, hold=1.0), replace=True)
    ocp_envs.register(PENDULUM, replace=True)
