"""Frames, windows and plots; drawn without a screen."""

from __future__ import annotations

import dataclasses
import sys

import gymnasium as gym
import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

from matplotlib import pyplot  # noqa: E402

import ocp_envs  # noqa: E402
from ocp_envs.env import Env, VectorEnv  # noqa: E402
from ocp_envs.picture import Ball, Line, Picture  # noqa: E402
from ocp_envs.problems.pendulum import PENDULUM  # noqa: E402
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE  # noqa: E402
from ocp_envs.rendering import Scene, plot_trajectory  # noqa: E402
from ocp_envs.trajectory import Trajectory  # noqa: E402


def in_space():
    """The quadcopter with a picture of its own: a cross, and the obstacle."""

    def body(state, context):
        position = state[:3]
        arms = [Line(np.array([position - arm, position + arm])) for arm in 0.5 * np.eye(3)[:2]]
        return [*arms, Ball(context[:3], context[3], alpha=0.4), Ball(position, 0.1)]

    picture = Picture(((-8.0, 8.0),) * 3, body, lambda states: states[:, :3])
    return dataclasses.replace(QUADCOPTER_OBSTACLE, picture=picture)


def brown_centre(frame):
    """Mean pixel (column, row) of the pendulum's colour #8c4a2f."""
    rows, columns = np.nonzero((np.abs(frame.astype(int) - [0x8C, 0x4A, 0x2F]) < 12).all(axis=2))
    return columns.mean(), rows.mean()


def test_the_pendulum_is_drawn_where_it_is():
    env = gym.make("PendulumSwingup-v0", render_mode="rgb_array")
    centres = []
    for theta in (0.0, np.pi / 2, np.pi, 3 * np.pi / 2):
        env.reset(options={"parameters": [theta, 0.0]})
        frame = env.render()
        assert frame.shape == (480, 480, 3)
        assert frame.dtype == np.uint8
        centres.append(brown_centre(frame))
    (below_x, below), (right, level), (above_x, above), (left, also_level) = centres
    assert left < below_x - 50 < right - 100
    assert above < level - 50 < below - 100
    assert below_x == pytest.approx(above_x, abs=2)
    assert level == pytest.approx(also_level, abs=2)


def test_the_trail_grows_and_a_reset_clears_it():
    env = Env(PENDULUM, render_mode="rgb_array", terminate_at_goal=False)
    env.reset(options={"parameters": [1.0, 2.0]})
    fresh = env.render()
    for _ in range(60):
        env.step(np.ones(1))
    assert (env.render() != fresh).any(axis=2).sum() > 500
    env.reset(options={"parameters": [1.0, 2.0]})
    np.testing.assert_array_equal(env.render(), fresh)


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


def test_space_is_drawn_in_space():
    env = Env(in_space(), render_mode="rgb_array")
    frames = []
    for x in (-6.0, 6.0):
        env.reset(options={"parameters": [x, 3.0, 2.0, 1.0, -2.0, 0.0, 2.0]})
        env.step(np.full(4, 2.0))
        frames.append(env.render())
    assert frames[0].shape == (480, 480, 3)
    assert (frames[0] != frames[1]).any(axis=2).sum() > 100


def test_artists_follow_shapes_that_come_and_go():
    def body(state, context):
        many = [Line(np.array([[0.0, 0.0], [1.0, 1.0]])), Ball(np.zeros(2), 0.2)]
        return many if state[1] > 0 else many[::-1][:1]

    problem = dataclasses.replace(PENDULUM, picture=Picture(((-2.0, 2.0),) * 2, body, lambda x: x))
    scene = Scene(problem)
    pictures = []
    for omega in (1.0, -1.0, 1.0):
        scene.draw(np.array([[0.0, omega]]), np.zeros(0), 0.0, 0.0)
        pictures.append(scene.pixels())
    np.testing.assert_array_equal(pictures[0], pictures[2])
    assert (pictures[0] != pictures[1]).any()


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


def test_without_a_mode_nothing_is_drawn():
    env = Env(PENDULUM)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    envs = VectorEnv(PENDULUM, 2)
    with pytest.warns(UserWarning, match="render_mode"):
        assert envs.render() is None


def test_what_cannot_be_drawn_says_so(monkeypatch):
    with pytest.raises(ValueError, match="has no picture"):
        Env(dataclasses.replace(PENDULUM, picture=None), render_mode="rgb_array")
    with pytest.raises(ValueError, match="plot_trajectory"):
        Scene(dataclasses.replace(PENDULUM, picture=None))
    with pytest.raises(ValueError, match="reset"):
        Env(PENDULUM, render_mode="rgb_array").render()
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    env = Env(PENDULUM, render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(ImportError, match=r"pip install 'ocp-moe\[plots\]'"):
        env.render()


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER_OBSTACLE], ids=lambda p: p.id)
def test_trajectories_are_plotted_against_time(problem):
    nx, nu, knots = problem.system.nx, problem.system.nu, problem.knots
    generator = np.random.default_rng(0)
    trajectory = Trajectory(
        generator.normal(size=(3, knots, nx)), generator.uniform(size=(3, knots - 1, nu)), np.array([2.0, 3.0, 4.0])
    )
    axes = plot_trajectory(problem, trajectory)
    assert axes.shape == (nx + nu,)
    for i in range(nx):
        drawn = axes[i].lines[1]
        np.testing.assert_array_equal(drawn.get_ydata(), trajectory.states[1, :, i])
        np.testing.assert_allclose(drawn.get_xdata(), np.linspace(0, 3.0, knots))
    np.testing.assert_array_equal(axes[nx].lines[2].get_ydata()[:-1], trajectory.controls[2, :, 0])
    assert axes[0].get_ylabel() == ("theta (rad)" if problem is PENDULUM else "x (m)")
    again = plot_trajectory(problem, trajectory[0], axes)
    assert again[0].figure is axes[0].figure
    with pytest.raises(ValueError, match=f"expected {nx + nu} axes"):
        plot_trajectory(problem, trajectory, axes[:1])
    pyplot.close(axes[0].figure)


def test_importing_the_package_does_not_import_matplotlib():
    import subprocess

    code = "import sys, ocp_envs; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert callable(ocp_envs.plot_trajectory)
