"""Features, actions, the wrappers made of them, and the adapter to Stable-Baselines3."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import ocp_envs
from moe_policy.rl.vec_env import SB3VecEnv
from moe_policy.rl.wrappers import (
    Actions,
    FeatureObservation,
    Features,
    NormalisedAction,
    VectorFeatureObservation,
    VectorNearStarts,
    VectorNormalisedAction,
    VectorShapedReward,
)
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE

ENV_ID = "PendulumSwingup-v0"
CATALOGUE = [*ocp_envs.problems.BENCHMARK]


def wrapped(**arguments):
    return NormalisedAction(FeatureObservation(gym.make(ENV_ID, **arguments)))


def wrapped_vector(num_envs, autoreset_mode="Disabled", **arguments):
    envs = gym.make_vec(ENV_ID, num_envs=num_envs, autoreset_mode=autoreset_mode, **arguments)
    return VectorNormalisedAction(VectorFeatureObservation(envs))


# -- features and actions ----------------------------------------------------------------------------------------------


@given(theta=st.floats(-12, 18), omega=st.floats(-6, 6), turns=st.integers(-2, 2))
def test_features_of_the_pendulum_are_sine_cosine_and_scaled_rate(theta, omega, turns):
    expected = [np.sin(theta), np.cos(theta), omega / 2.0]
    features = Features(PENDULUM)
    np.testing.assert_allclose(features([theta, omega]), expected, atol=1e-6)
    np.testing.assert_allclose(features([[theta + 2 * np.pi * turns, omega]]), [expected], atol=1e-5)


def test_features_scale_states_by_their_size_and_context_by_its_box():
    problem = QUADCOPTER_OBSTACLE
    rng = np.random.default_rng(0)
    state = problem.system.state.draw(rng, 5)
    context = np.array([[-10.0, 0.0, 10.0, 1.0]] * 4 + [[5.0, 5.0, 5.0, 5.0]])
    values = Features(problem)(np.hstack([state, context]))
    assert values.shape == (5, 17)
    np.testing.assert_allclose(values[:, :2], np.stack([np.sin(state[:, 8]), np.cos(state[:, 8])], 1), atol=1e-6)
    np.testing.assert_allclose(values[:, 2:5], state[:, :3] / 5, rtol=1e-6)
    np.testing.assert_allclose(values[:4, -4:], [[-1, 0, 1, -1]] * 4, atol=1e-6)
    np.testing.assert_allclose(values[4, -4:], [0.5, 0.5, 0.5, 1.0], atol=1e-6)


@pytest.mark.parametrize("problem", [*CATALOGUE, QUADCOPTER_OBSTACLE], ids=lambda p: p.id)
def test_the_feature_space_holds_the_features_of_the_corners_of_the_box(problem):
    features = Features(problem)
    for side in ("lower", "upper"):
        corner = np.concatenate([getattr(problem.system.state, side), getattr(problem.context, side)])
        assert features.space.contains(features(corner))
        assert features.space.contains(features(corner.astype(np.float32)))


def test_features_refuse_observations_of_another_size():
    with pytest.raises(ValueError, match=r"expected observations \(\.\.\., 2\), got \(4, 3\)"):
        Features(PENDULUM)(np.zeros((4, 3)))


def test_actions_map_the_ends_and_the_middle_and_clip():
    actions = Actions(QUADCOPTER_OBSTACLE)
    np.testing.assert_allclose(actions.controls([-1, 0, 1, 2]), [0, 2, 4, 4])
    controls = np.random.default_rng(0).uniform(0, 4, (7, 4))
    np.testing.assert_allclose(actions.controls(actions.actions(controls)), controls, atol=1e-12)


# -- wrappers ----------------------------------------------------------------------------------------------------------


def test_the_scalar_wrappers_change_what_is_seen_and_done_and_nothing_else():
    p = np.array([1.0, -0.5])
    env, bare = wrapped(), gym.make(ENV_ID)
    seen, _ = env.reset(options={"parameters": p})
    bare.reset(options={"parameters": p})
    np.testing.assert_allclose(seen, [np.sin(1), np.cos(1), -0.25], atol=1e-6)
    for action in ([0.3], [-1.0], [5.0]):
        seen, reward, *_ = env.step(np.array(action))
        observation, bare_reward, *_ = bare.step(np.clip(action, -1, 1))
        assert seen in env.observation_space
        np.testing.assert_array_equal(seen, Features(PENDULUM)(observation))
        assert reward == bare_reward


def test_the_vector_wrappers_agree_with_the_scalar_ones_row_by_row():
    rng = np.random.default_rng(1)
    envs, rows = wrapped_vector(4), [wrapped() for _ in range(4)]
    seen, _ = envs.reset(seed=5)
    np.testing.assert_array_equal(seen, [env.reset(seed=5 + i)[0] for i, env in enumerate(rows)])
    for _ in range(20):
        actions = rng.uniform(-1, 1, (4, 1))
        seen, rewards, *_ = envs.step(actions)
        single = [env.step(action) for env, action in zip(rows, actions)]
        np.testing.assert_array_equal(seen, [step[0] for step in single])
        np.testing.assert_array_equal(rewards, [step[1] for step in single])
    assert envs.single_observation_space == rows[0].observation_space
    assert envs.single_action_space == rows[0].action_space


# -- the adapter -------------------------------------------------------------------------------------------------------


def swing(observations):
    """Pump energy into the pendulum: most episodes pass the goal ball's neighbourhood, some reach it."""
    sine, cosine, rate = observations.T
    energy = 2 * rate**2 - cosine - 1
    return np.clip(np.where(cosine < -0.95, -3 * rate + 2 * sine, -2 * energy * np.sign(rate)), -1, 1)[:, None]


def test_the_adapter_agrees_with_dummy_vec_env_row_by_row():
    arguments = {"dt": 0.1, "time_limit": 6.0}
    ours = VecMonitor(SB3VecEnv(wrapped_vector(6, **arguments)))
    theirs = VecMonitor(DummyVecEnv([lambda: wrapped(**arguments)] * 6))
    for env in (ours, theirs):
        env.seed(11)
    a, b = ours.reset(), theirs.reset()
    kinds = set()
    for _ in range(300):
        np.testing.assert_array_equal(a, b)
        actions = swing(a)
        a, our_rewards, our_dones, our_infos = ours.step(actions)
        b, their_rewards, their_dones, their_infos = theirs.step(actions)
        np.testing.assert_array_equal(our_rewards, their_rewards)
        np.testing.assert_array_equal(our_dones, their_dones)
        for mine, other in zip(our_infos, their_infos):
            assert mine.keys() == other.keys()
            assert mine["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert mine["is_success"] == other["is_success"]
            assert mine["cost"] == other["cost"]
            if "terminal_observation" in mine:
                np.testing.assert_array_equal(mine["terminal_observation"], other["terminal_observation"])
                assert (mine["episode"]["r"], mine["episode"]["l"]) == (other["episode"]["r"], other["episode"]["l"])
                kinds.add(mine["TimeLimit.truncated"])
    assert kinds == {True, False}, "the test must see episodes that end and episodes that are cut off"
    for mine, other in zip(ours.venv.reset_infos, theirs.venv.reset_infos):
        np.testing.assert_array_equal(mine["parameters"], other["parameters"])


def test_leaving_the_box_is_an_end_with_its_cause():
    env = SB3VecEnv(wrapped_vector(2, dt=0.1, time_limit=1000.0, terminate_at_goal=False))
    env.seed(0)
    env.reset()
    dones, infos = np.zeros(2, bool), [{}]
    for _ in range(3000):
        rate = np.stack(env.get_attr("state"))[:, 1:]
        _, _, dones, infos = env.step(np.where(rate >= 0, 1.0, -1.0))
        if dones.any():
            break
    row = int(np.flatnonzero(dones)[0])
    assert infos[row]["failure"] == "left_box"
    assert not infos[row]["TimeLimit.truncated"]


def test_seeds_and_options_are_used_once():
    env = SB3VecEnv(wrapped_vector(3))
    p = np.array([[0.5, 0.0], [1.0, 1.0], [2.0, -1.0]])
    env.set_options([{"parameters": row} for row in p])
    env.reset()
    np.testing.assert_array_equal(np.stack(env.get_attr("parameters")), p)
    env.seed(3)
    first = env.reset()
    assert not np.array_equal(env.reset(), first)
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), first)


def test_attributes_are_read_by_row_and_set_for_all():
    env = SB3VecEnv(wrapped_vector(3, dt=0.05))
    env.reset()
    assert env.get_attr("dt", indices=[0, 2]) == [0.05, 0.05]
    assert [state.shape for state in env.get_attr("state", indices=1)] == [(2,)]
    assert env.has_attr("problem")
    assert not env.has_attr("no_such_thing")
    assert env.env_is_wrapped(VectorFeatureObservation) == [True] * 3
    assert env.env_is_wrapped(gym.wrappers.vector.ClipReward, indices=[0]) == [False]
    env.set_attr("note", "x")
    assert env.get_attr("note") == ["x"] * 3
    with pytest.raises(ValueError, match="one batched environment"):
        env.set_attr("note", "y", indices=[0])
    assert env.env_method("close_extras") == [None] * 3
    env.close()


def test_an_environment_that_restarts_by_itself_is_refused():
    with pytest.raises(ValueError, match='autoreset_mode="Disabled"'):
        SB3VecEnv(gym.make_vec(ENV_ID, num_envs=2))


def test_shaping_telescopes_and_scales():
    """Undiscounted, shaped returns of episodes that end differ by the first potential alone."""
    envs = gym.make_vec(
        "GroundVehicle-v0",
        num_envs=3,
        vectorization_mode="vector_entry_point",
        dt=0.1,
        autoreset_mode="Disabled",
        time_limit=1.0,
    )
    shaped = VectorShapedReward(envs, scale=0.5, weight=4.0, gamma=1.0)
    p = np.array([[3.0, -4.0, 0.0, 0.0], [0.3, 0.0, 0.1, -0.5], [9.0, 9.0, 3.0, 3.0]])
    shaped.reset(options={"parameters": p})
    first = envs.unwrapped.problem.goal_error(envs.unwrapped.state)
    np.testing.assert_allclose(first[0], 5.0)
    total, cost, ended = np.zeros(3), np.zeros(3), np.zeros(3, bool)
    for _ in range(10):
        _, rewards, terminated, _, info = shaped.step(np.tile([0.1, 0.4], (3, 1)))
        total += rewards
        cost += info["cost"]
        ended |= terminated
    assert ended.tolist() == [False, True, False]  # the second enters the goal ball, where the potential is zero
    last = np.where(ended, 0.0, envs.unwrapped.problem.goal_error(envs.unwrapped.state))
    np.testing.assert_allclose(total, 0.5 * (-cost - 4.0 * last + 4.0 * first), rtol=1e-6)


def test_distance_has_its_price():
    rewards = []
    for price in (0.0, 3.0):
        envs = gym.make_vec(ENV_ID, num_envs=2, vectorization_mode="vector_entry_point", autoreset_mode="Disabled")
        priced = VectorShapedReward(envs, scale=0.5, weight=0.0, gamma=0.99, distance_price=price)
        priced.reset(options={"parameters": np.array([[0.5, 0.0], [3.0, 1.0]])})
        rewards.append(priced.step(np.zeros((2, 1)))[1])
        base = envs.unwrapped
        distance = base.problem.goal_error(base.state)
    np.testing.assert_allclose(rewards[0] - rewards[1], 0.5 * 3.0 * base.dt * distance)


def test_what_one_step_costs_the_learner_can_be_bounded():
    """A pendulum that leaves its box is charged for the rest of the episode; the learner only for as much as is set."""
    rewards = {}
    for largest in (np.inf, 30.0):
        envs = gym.make_vec(ENV_ID, num_envs=2, vectorization_mode="vector_entry_point", autoreset_mode="Disabled")
        bounded = VectorShapedReward(envs, scale=0.5, weight=0.0, gamma=0.99, largest_cost=largest)
        leaving = PENDULUM.system.state.upper - [0.01, 1.0]
        bounded.reset(options={"parameters": np.array([[1.0, 0.0], leaving]), "extrapolate": True})
        rewards[largest] = np.array([bounded.step(np.zeros((2, 1)))[1] for _ in range(3)])
    assert rewards[np.inf].min() < -15.0
    np.testing.assert_allclose(rewards[30.0], np.maximum(rewards[np.inf], -15.0))


def test_near_starts_lie_between_the_goal_and_the_box():
    count = 400
    envs = gym.make_vec(
        "GroundVehicle-v0", num_envs=count, vectorization_mode="vector_entry_point", autoreset_mode="Disabled"
    )
    near = VectorNearStarts(envs, 0.5, seed=0)
    _, info = near.reset()
    box = envs.unwrapped.problem.parameters
    assert box.contains(info["parameters"]).all()
    # Of a uniform draw the largest share of a half width exceeds 1/4 in all but (1/4)^4 of the cases.
    reach = np.abs(info["parameters"] / box.upper).max(axis=1)
    assert 0.5 * 0.2 * count < (reach < 0.25).sum() < 0.5 * 0.5 * count
    p = np.array([1.0, 2.0, 0.5, 0.0])
    _, info = near.reset(options={"parameters": p})
    np.testing.assert_array_equal(info["parameters"], np.tile(p, (count, 1)))
    masked = np.arange(count) < 3
    _, info = near.reset(options={"reset_mask": masked})
    assert info["_parameters"].sum() == 3


def obstacle_envs(count):
    return gym.make_vec(
        "QuadcopterObstacle-v0", num_envs=count, vectorization_mode="vector_entry_point", autoreset_mode="Disabled"
    )


def test_near_starts_round_a_sphere_keep_the_sphere_and_stay_outside_of_it():
    near = VectorNearStarts(obstacle_envs(200), 1.0, seed=0)
    _, info = near.reset()
    p, table = info["parameters"], ocp_envs.tables.starts(QUADCOPTER_OBSTACLE)
    assert (np.linalg.norm(p[:, :3] - p[:, 3:6], axis=1) >= p[:, 6]).all()
    spheres = {tuple(row) for row in table[:, 3:]}
    assert all(tuple(row) in spheres for row in p[:, 3:])
    starts = {tuple(row) for row in table[:, :3]}
    assert 100 < sum(tuple(row) not in starts for row in p[:, :3]) <= 200


def test_violations_are_charged_at_their_price():
    p = np.array([0.0, 4.0, 4.0, 0.0, 4.0, 0.5, 3.4])  # falls into the sphere below
    rewards = []
    for price in (0.0, 50.0):
        envs = VectorShapedReward(obstacle_envs(1), 0.5, 0.0, 0.99, price)
        envs.reset(options={"parameters": p[None]})
        charged = []
        for _ in range(20):
            _, reward, _, _, info = envs.step(np.zeros((1, 4)))
            charged.append((reward[0], info["violation"][0]))
        rewards.append(np.array(charged))
    free, priced = rewards
    assert priced[:, 1].max() > 0.1
    np.testing.assert_allclose(free[:, 0] - priced[:, 0], 0.5 * 50 * 0.02 * priced[:, 1], atol=1e-6)
