"""What the environments draw of their episodes, without a screen."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

from matplotlib import pyplot  # noqa: E402

from ocp_envs.envs.env import Env  # noqa: E402
from ocp_envs.envs.vector_env import VectorEnv  # noqa: E402
from ocp_envs.problems.pendulum import PENDULUM  # noqa: E402
from ocp_envs.trajectory import Trajectory  # noqa: E402


def changed(a, b):
    return int((a != b).any(axis=2).sum())


def test_the_environments_show_a_plan_until_the_next_episode():
    states = np.zeros((2, 25, 4))
    states[..., 0], states[..., 1] = np.linspace(-9, 0, 25), np.linspace(5, 0, 25)
    plans, p = Trajectory(states, np.zeros((2, 24, 2)), np.ones(2)), [-9.0, 5.0, 0.0, 0.0]
    env = gym.make("GroundVehicle-v0", render_mode="rgb_array").unwrapped
    envs = gym.make_vec(
        "GroundVehicle-v0", num_envs=2, vectorization_mode="vector_entry_point", render_mode="rgb_array"
    ).unwrapped
    for made, shown, frame in ((env, plans[0], lambda: env.render()), (envs, plans, lambda: envs.render()[1])):
        made.reset(options={"parameters": p})
        before = frame()
        made.show_plan(shown)
        assert changed(frame(), before) > 100
        made.reset(options={"parameters": p})
        np.testing.assert_array_equal(frame(), before)
        with pytest.raises(ValueError, match="expected a plan for each"):
            made.show_plan(plans[[0, 1, 1]])


def test_vector_environments_draw_every_row():
    envs = VectorEnv(PENDULUM, 2, render_mode="rgb_array", time_limit=0.1)
    single = Env(PENDULUM, render_mode="rgb_array", time_limit=1.0)
    envs.reset(options={"parameters": [[0.5, 0.0], [2.0, 0.0]]})
    single.reset(options={"parameters": [2.0, 0.0]})
    for _ in range(4):
        envs.step(np.ones((2, 1)))
        single.step(np.ones(1))
    frames = envs.render()
    assert len(frames) == 2
    np.testing.assert_array_equal(frames[1], single.render())
    assert (frames[0] != frames[1]).any()


def test_the_trail_grows_and_a_reset_clears_it():
    env = Env(PENDULUM, render_mode="rgb_array", terminate_at_goal=False)
    env.reset(options={"parameters": [1.0, 2.0]})
    fresh = env.render()
    for _ in range(60):
        env.step(np.ones(1))
    assert (env.render() != fresh).any(axis=2).sum() > 500
    env.reset(options={"parameters": [1.0, 2.0]})
    np.testing.assert_array_equal(env.render(), fresh)


@pytest.mark.filterwarnings("ignore:PendulumSwingup-v0. no window opens:UserWarning")
def test_human_mode_opens_one_window_and_closes_it():
    env = gym.make("PendulumSwingup-v0", render_mode="human")
    before = pyplot.get_fignums()
    env.reset(seed=0)
    env.step(np.ones(1))
    env.reset()
    assert len(pyplot.get_fignums()) == len(before) + 1
    env.close()
    assert pyplot.get_fignums() == before
    envs = gym.make_vec("PendulumSwingup-v0", num_envs=2, render_mode="human")
    envs.reset(seed=0)
    envs.step(np.ones((2, 1)))
    assert envs.render() is None
    envs.close()
    assert pyplot.get_fignums() == before


def test_human_mode_warns_where_matplotlib_opens_no_window(monkeypatch):
    monkeypatch.setattr(pyplot, "get_backend", lambda: "Agg")
    env = Env(PENDULUM, render_mode="human")
    with pytest.warns(UserWarning, match=r"no window opens.*'Agg'.*MPLBACKEND.*rgb_array"):
        env.reset(seed=0)
    env.close()
    monkeypatch.setattr(pyplot, "get_backend", lambda: "TkAgg")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.reset(seed=0)
    env.close()


def test_without_a_mode_nothing_is_drawn():
    env = Env(PENDULUM)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    envs = VectorEnv(PENDULUM, 2)
    with pytest.warns(UserWarning, match="render_mode"):
        assert envs.render() is None
