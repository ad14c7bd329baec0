"""Curricula: where episodes of a learner begin and end."""

import gymnasium as gym
import numpy as np

import ocp_envs
from moe_policy.rl.curriculum import VectorNearStarts, VectorShrinkingGoal, with_moving_starts
from moe_policy.rollouts.environments import environments
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from tests.learners import obstacle_envs


def test_near_starts_lie_between_the_goal_and_the_box():
    count = 400
    envs = gym.make_vec(
        "GroundVehicle-v0", num_envs=count, vectorization_mode="vector_entry_point", autoreset_mode="Disabled"
    )
    near = VectorNearStarts(envs, fraction=0.5, seed=0)
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


def test_near_starts_round_a_sphere_keep_the_sphere_and_stay_outside_of_it():
    near = VectorNearStarts(obstacle_envs(200), 1.0, seed=0)
    _, info = near.reset()
    p, table = info["parameters"], ocp_envs.tables.starts(QUADCOPTER_OBSTACLE)
    assert (np.linalg.norm(p[:, :3] - p[:, 3:6], axis=1) >= p[:, 6]).all()
    spheres = {tuple(row) for row in table[:, 3:]}
    assert all(tuple(row) in spheres for row in p[:, 3:])
    starts = {tuple(row) for row in table[:, :3]}
    assert 100 < sum(tuple(row) not in starts for row in p[:, :3]) <= 200


def test_near_starts_can_be_in_motion_and_the_others_are_those_of_the_problem():
    moving = with_moving_starts(QUADCOPTER_OBSTACLE)
    envs = environments(moving, 300, terminate_at_goal=True)
    near = VectorNearStarts(envs, 0.5, 0, moving=0.3, problem=QUADCOPTER_OBSTACLE, nearness=2.0)
    near.reset()
    states, own = envs.state, {tuple(row) for row in ocp_envs.tables.starts(QUADCOPTER_OBSTACLE)[:, :3]}
    at_rest = (states[:, 3:] == 0).all(axis=1)
    assert 150 < at_rest.sum() < 250  # some of the nearer ones would begin in the sphere
    assert all(tuple(row) in own for row in states[at_rest, :3])
    assert 0.02 < np.std(states[~at_rest, 3:6]) / 5 < 0.3


def test_the_goal_ball_shrinks_to_that_of_the_problem_as_episodes_end_in_it():
    def stepped(offsets):
        envs.reset(options={"parameters": [[np.pi + offset, 0.0] for offset in offsets]})
        return envs.step(np.zeros((3, 1)))[2].tolist()

    envs = VectorShrinkingGoal(environments(PENDULUM, 3, terminate_at_goal=True), first=0.12)
    assert stepped([0.11, 0.105, 0.3]) == [True, True, False]
    np.testing.assert_allclose(envs.radius, 0.12)  # two episodes have ended, which are fewer than there are rows
    assert stepped([0.11, 0.105, 0.05]) == [True, True, True]
    np.testing.assert_allclose(envs.radius, 0.108)
    assert stepped([0.11, 0.105, 0.05]) == [False, True, True]
    assert stepped([0.11, 0.105, 0.05]) == [False, True, True]
    np.testing.assert_allclose(envs.radius, 0.1)
    assert stepped([0.11, 0.105, 0.05]) == [False, False, True]


def test_the_goal_ball_stays_as_large_where_episodes_end_elsewhere():
    envs = VectorShrinkingGoal(environments(PENDULUM, 3, terminate_at_goal=True, time_limit=0.02), first=0.4)
    envs.reset(options={"parameters": [[np.pi, 0.0], [0.0, 0.0], [1.0, 0.0]]})
    envs.step(np.zeros((3, 1)))
    assert envs.radius == 0.4
