"""The single environment: Gymnasium's and Stable-Baselines3's contracts, ends, charges, imperfections, bad input."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import re
import subprocess
import sys
import warnings
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import ocp_envs
from ocp_envs.envs.env import Env
from ocp_envs.envs.simulation import Simulator, largest_cost_rate
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from tests.small_problems import DOUBLE_INTEGRATOR

PROBLEMS = [ocp_envs.load(name) for name in ocp_envs.names()]
each_problem = pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)


def at_goal(problem):
    """Options of a reset to the goal state in a context at a corner of its box, clear of any obstacle."""
    corner = problem.context.lower[None]
    return {"parameters": problem.parameters_of(problem.terminal.states(corner), corner)[0], "extrapolate": True}


@each_problem
def test_passes_gymnasiums_checker(problem):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(Env(problem), skip_render_check=True)
    messages = [str(w.message) for w in caught if "environment's spec" not in str(w.message)]
    assert all("normalized" in m or "symmetric" in m for m in messages), messages


def test_made_by_name_passes_the_checker_with_one_kind_of_warning_besides_that_of_a_missing_display():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gym.make("PendulumSwingup-v0", render_mode="rgb_array").unwrapped)
    assert not [m for w in caught if "normalized" not in (m := str(w.message)) and "no window opens" not in m]


@pytest.mark.parametrize("make", [Env, lambda problem: VectorEnv(problem, 1)], ids=["single", "vector"])
def test_without_a_picture_no_render_mode_is_offered_and_the_checker_passes(make):
    assert DOUBLE_INTEGRATOR.picture is None
    assert make(DOUBLE_INTEGRATOR).metadata["render_modes"] == []
    assert make(PENDULUM).metadata["render_modes"] == ["rgb_array", "human"]
    spec = EnvSpec(DOUBLE_INTEGRATOR.id, partial(Env, DOUBLE_INTEGRATOR))
    check_env(gym.make(spec).unwrapped)  # which draws in every mode that the environment offers


@each_problem
def test_passes_the_checker_of_stable_baselines3(problem):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        checker.check_env(Env(problem), warn=True)
    messages = [str(w.message) for w in caught]
    assert all("symmetric" in m or "normalized" in m for m in messages), messages


@each_problem
def test_a_step_equals_advance(problem):
    env = Env(problem, terminate_at_goal=False)
    simulator = Simulator(problem, 0.02)
    observation, info = env.reset(seed=4)
    state, context = env.state[None], env.context[None]
    expected_state, expected_context = problem.start(info["parameters"][None])
    np.testing.assert_array_equal(state, expected_state)
    np.testing.assert_array_equal(context, expected_context)
    env.action_space.seed(4)
    for _ in range(10):
        action = env.action_space.sample()
        step = simulator.advance(state, action[None].astype(float), context)
        observation, reward, terminated, truncated, info = env.step(action)
        assert observation in env.observation_space
        np.testing.assert_array_equal(env.state, step.states[0])
        np.testing.assert_array_equal(observation, np.concatenate([env.state, env.context]).astype(np.float32))
        assert (reward, terminated, truncated) == (-info["cost"], bool(step.left_box[0]), False)
        assert info["is_success"] is bool(step.reached[0])
        assert terminated or info["cost"] == step.cost[0]
        assert ("violation" in info) == (problem.clearance is not None)
        if problem.clearance is not None:
            assert info["violation"] == step.violation[0]
        if terminated:
            break
        state = step.states


def test_no_import_is_needed():
    code = "import gymnasium as gym; print(gym.make('ocp_envs:PendulumSwingup-v0').reset(seed=0)[0].shape)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "(2,)"


def test_observation_box_holds_what_float32_makes_of_its_corners():
    env = Env(PENDULUM)
    for corner in (PENDULUM.system.state.lower, PENDULUM.system.state.upper):
        assert corner.astype(np.float32) in env.observation_space
    bound = np.array([2 * np.pi, 2.0])
    env.reset(options={"parameters": bound.astype(np.float32)})  # float32(2π) > 2π
    assert env.parameters[0] > 2 * np.pi


@each_problem
def test_goal_terminates_unless_told_otherwise(problem):
    if problem.goal_error(*(rows[0] for rows in problem.start(at_goal(problem)["parameters"][None]))):
        pytest.skip("no initial state is at the goal")
    for stop in (True, False):
        env = Env(problem, terminate_at_goal=stop)
        env.reset(options=at_goal(problem))
        assert problem.goal_error(env.state, env.context) == 0
        _, _, terminated, truncated, info = env.step(problem.terminal.central_control.astype(np.float32))
        assert (terminated, truncated, info["is_success"]) == (stop, False, True)
        assert info["failure"] == ""


def test_time_limit_is_in_seconds_whatever_the_control_step():
    for dt, limit, steps in ((0.02, None, 1000), (0.1, 1.0, 10), (0.3, 1.0, 4)):
        env = gym.make("PendulumSwingup-v0", dt=dt, time_limit=limit, terminate_at_goal=False)
        env.reset(options={"parameters": [0.0, 0.0]})
        ends = []
        while not (ends and any(ends[-1])):
            _, _, terminated, truncated, info = env.step(np.zeros(1, np.float32))
            ends.append((terminated, truncated))
        assert len(ends) == steps
        assert ends[-1] == (False, True)
        assert not info["is_success"]


def test_leaving_the_box_costs_more_than_anything_that_stays():
    env = Env(PENDULUM, dt=0.1, time_limit=20.0, constants={"torque_gain": 30.0})
    env.reset(seed=0)
    total, steps = 0.0, 0
    terminated = False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.ones(1))
        total -= reward
        steps += 1
    assert info["failure"] == "left_box"
    assert not truncated
    assert not info["is_success"]
    assert info["cost"] == pytest.approx(largest_cost_rate(PENDULUM) * (20.0 - 0.1 * (steps - 1)))
    assert total == pytest.approx(2.0 * 20.0)  # full torque until then costs the largest rate, too
    assert PENDULUM.system.state.contains(env.state)


def test_a_finished_episode_does_not_step():
    env = Env(PENDULUM, time_limit=0.02)
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(np.zeros(1))
    env.reset(seed=0)
    env.step(np.zeros(1))
    with pytest.raises(ResetNeeded, match="terminate_at_goal=False"):
        env.step(np.zeros(1))


def test_reset_draws_uniformly_and_by_seed():
    env = Env(PENDULUM)
    assert np.array_equal(env.reset(seed=5)[0], env.reset(seed=5)[0])
    assert not np.array_equal(env.reset()[0], env.reset()[0])
    draws = np.array([env.reset()[1]["parameters"] for _ in range(2000)])
    box = PENDULUM.parameters
    unit = (draws - box.lower) / box.width
    assert (unit >= 0).all()
    assert (unit <= 1).all()
    # Kolmogorov-Smirnov at a level of 1e-4: sup |F_n − F| < 2.2 / √n
    steps = np.arange(1, 2001)[:, None] / 2000
    assert np.abs(np.sort(unit, axis=0) - steps).max() < 2.2 / np.sqrt(2000)


def test_refuses_actions_of_another_shape():
    env = Env(QUADCOPTER_OBSTACLE)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"expected an action of shape \(4,\), got \(1,\)"):
        env.step(np.zeros(1))


def test_disturbance_and_noise_have_the_stated_size():
    dt, steps = 0.02, 4000
    env = Env(
        PENDULUM, dt=dt, time_limit=1e4, terminate_at_goal=False, disturbance=[0.0, 0.5], observation_noise=[0.1, 0.0]
    )
    env.reset(seed=1)
    simulator = Simulator(PENDULUM, dt)
    pushes, errors = [], []
    for _ in range(steps):
        if abs(env.state[1]) > 4 or abs(env.state[0] - np.pi) > 9:
            env.reset(options={"parameters": [0.0, 0.0]})
        undisturbed = simulator.advance(env.state[None], np.zeros((1, 1)), np.zeros((1, 0))).states[0]
        observation = env.step(np.zeros(1))[0]
        pushes.append((env.state - undisturbed)[1] / dt)
        errors.append(observation - env.state)
    assert np.std(pushes) == pytest.approx(0.5, rel=0.05)
    assert np.mean(pushes) == pytest.approx(0.0, abs=0.03)
    assert np.std(errors, axis=0)[0] == pytest.approx(0.1, rel=0.05)
    assert np.abs(errors, dtype=float)[:, 1].max() < 1e-6


def test_delay_holds_the_goal_first_and_then_lags():
    actions = np.linspace(-1, 1, 8)[:, None]
    late, prompt = Env(PENDULUM, delay=3), Env(PENDULUM)
    for env in (late, prompt):
        env.reset(options={"parameters": [1.0, 0.0]})
    for action in actions:
        late.step(action)
    for action in [*[PENDULUM.goal.control] * 3, *actions[:5]]:
        prompt.step(action)
    np.testing.assert_array_equal(late.state, prompt.state)


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"]
)
def test_a_copy_goes_on_alike_and_apart(duplicate):
    env = gym.make("PendulumSwingup-v0", disturbance=0.1, delay=2)
    env.reset(seed=3)
    for _ in range(5):
        env.step(np.ones(1))
    other = duplicate(env)
    for _ in range(5):
        first, second = env.step(np.full(1, 0.3)), other.step(np.full(1, 0.3))
        np.testing.assert_array_equal(first[0], second[0])
        assert first[1:4] == second[1:4]
        assert first[4]["cost"] == second[4]["cost"]
    env.step(np.zeros(1))
    assert not np.array_equal(env.unwrapped.state, other.unwrapped.state)


def test_a_users_problem_gets_environments_of_both_kinds():
    problem = dataclasses.replace(PENDULUM, id="MyPendulum-v0", duration=(0.1, 0.5), time_limit=0.5)
    ocp_envs.register(problem)
    ocp_envs.register(problem)
    try:
        assert gym.make("MyPendulum-v0").unwrapped.problem is problem
        assert gym.make_vec("MyPendulum-v0", num_envs=3).problem is problem
        with pytest.raises(ValueError, match="already registered"):
            ocp_envs.register(dataclasses.replace(problem, time_limit=1.0))
        with pytest.raises(ValueError, match="another id"):
            ocp_envs.register(dataclasses.replace(problem, id="CartPole-v1"))
    finally:
        from ocp_envs import problems

        del problems._catalogue["MyPendulum-v0"]
        del gym.registry["MyPendulum-v0"]


@each_problem
def test_description_names_everything(problem):
    text = ocp_envs.describe(problem)
    boxes = (problem.system.state, problem.system.control, problem.parameters)
    for name in (*(name for box in boxes for name in box.names), *problem.system.constants):
        assert re.search(rf"(^|\s){name} ", text)
    for heading in ("Description", "Action Space", "Observation Space", "Rewards", "Starting State", "Episode End"):
        assert f"## {heading}\n" in text
        assert f"## {heading}\n" in Env.__doc__


def test_every_public_name_is_there():
    assert all(hasattr(ocp_envs, name) for name in ocp_envs.__all__)


@each_problem
def test_every_info_has_the_same_keys(problem):
    env = Env(problem)
    _, info = env.reset(seed=0)
    ends = [env.step(problem.terminal.central_control)[4] for _ in range(3)]
    assert all(
        {key: np.shape(value) for key, value in each.items()} == {k: np.shape(v) for k, v in info.items()}
        for each in ends
    )
    assert all(type(each[key]) is type(info[key]) for each in ends for key in info)


def test_info_of_a_reset_tells_of_the_initial_state():
    blocked = dataclasses.replace(PENDULUM, id="Blocked-v0", clearance=lambda x, s, c: [x[0] - 1.0])
    env = Env(blocked)
    with pytest.raises(ValueError, match=r"begin where no episode can: clearance 0 is -0\.75"):
        env.reset(options={"parameters": [0.25, 0.0]})
    info = env.reset(options={"parameters": [1.5, 0.0]})[1]
    assert (info["violation"], info["is_success"], info["cost"], info["failure"]) == (0.0, False, 0.0, "")
    info = env.reset(options={"parameters": [np.pi, 0.0]})[1]
    assert (info["violation"], info["is_success"]) == (0.0, True)
