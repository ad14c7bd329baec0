"""What Gymnasium notes of an environment: its time limit in control steps, and arguments that JSON can hold."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

from ocp_envs.envs.env import Env
from ocp_envs.problems.pendulum import PENDULUM


@pytest.mark.parametrize("record_infos", [False, True])
def test_minari_collects_episodes(tmp_path, monkeypatch, record_infos):
    minari = pytest.importorskip("minari")
    pytest.importorskip("jax")  # its collector of episodes needs minari[create]
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = minari.DataCollector(gym.make("PendulumSwingup-v0"), record_infos=record_infos)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(2):
            env.reset(seed=seed)
            for _ in range(5):
                env.step(env.action_space.sample())
    data = env.create_dataset(
        "ocp/pendulum-v0", description="", algorithm_name="", author="", author_email="", code_permalink=""
    )
    assert data.total_steps == 10
    assert data.recover_environment().unwrapped.problem is PENDULUM


@pytest.mark.parametrize("number", [np.full(2, 0.1), [0.1, 0.1], np.float64(0.1), 0.1])
def test_specifications_hold_any_arguments_as_json(number):
    env = gym.make("PendulumSwingup-v0", disturbance=number, constants={"mass": np.float64(1.1)}, dt=np.float32(0.05))
    again = gym.make(EnvSpec.from_json(env.spec.to_json())).unwrapped
    np.testing.assert_array_equal(again.options.disturbance, env.unwrapped.options.disturbance)
    assert again.dt == env.unwrapped.dt
    envs = gym.make_vec("PendulumSwingup-v0", num_envs=2, disturbance=number, autoreset_mode=AutoresetMode.DISABLED)
    assert gym.make_vec(EnvSpec.from_json(envs.spec.to_json())).num_envs == 2


@pytest.mark.parametrize(
    ("arguments", "steps"),
    [({}, 1000), ({"dt": 0.05}, 400), ({"time_limit": 0.3}, 15), ({"max_episode_steps": 10}, 10)],
)
def test_specifications_know_the_number_of_control_steps_to_the_time_limit(arguments, steps):
    env, envs = gym.make("PendulumSwingup-v0", **arguments), gym.make_vec("PendulumSwingup-v0", num_envs=2, **arguments)
    assert env.spec.max_episode_steps == envs.spec.max_episode_steps == steps
    assert gym.make(env.spec).spec.max_episode_steps == steps


def test_observations_can_be_aware_of_time():
    env = gym.wrappers.TimeAwareObservation(
        gym.make("PendulumSwingup-v0", time_limit=0.1), flatten=True, normalize_time=True
    )
    env.reset(seed=0)
    assert env.step(np.zeros(1, np.float32))[0][-1] == pytest.approx(0.2)


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
def test_episodes_can_be_limited_to_a_number_of_control_steps(mode):
    envs = gym.make_vec("PendulumSwingup-v0", num_envs=2, vectorization_mode=mode, max_episode_steps=10)
    envs.reset(seed=0)
    ends = [envs.step(np.zeros((2, 1), np.float32))[3].tolist() for _ in range(10)]
    assert ends == [[False, False]] * 9 + [[True, True]]


@pytest.mark.parametrize("steps", [0, -3, 2.5, "10"])
def test_a_limit_that_is_no_number_of_control_steps_is_refused(steps):
    with pytest.raises((TypeError, ValueError), match=r"max_episode_steps(: expected| must be) a (whole|positive)"):
        Env(PENDULUM, max_episode_steps=steps)
