"""What all policies have in common: actions in the action space, exact controls below them, and odd observations."""

import pickle

import gymnasium as gym
import numpy as np
import pytest

import moe_policy
from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.protocols import ExactPolicy, Policy
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from tests.closed_loop import rest_planner
from tests.learners import observations, random_policy
from tests.small_problems import DOUBLE_INTEGRATOR


def policies():
    tracking = TrackingPolicy(PENDULUM, moe_policy.load(PENDULUM, "nearest"))
    learned = random_policy()
    return [tracking, Stabiliser(PENDULUM), Stabilised(learned, PENDULUM), learned]


each_policy = pytest.mark.parametrize("policy", policies(), ids=lambda policy: type(policy).__name__)


@each_policy
def test_actions_are_in_the_action_space_and_controls_are_exact(policy):
    envs, seen = environments(PENDULUM, 20), observations(20)
    actions, _ = policy.predict(seen)
    assert actions.dtype == np.float32
    assert actions in envs.action_space
    assert policy.predict(seen[0])[0] in envs.single_action_space
    controls, _ = policy.act(seen, None, np.ones(20, bool))
    assert controls.dtype == np.float64
    np.testing.assert_array_equal(actions, controls.astype(np.float32))
    assert isinstance(policy, ExactPolicy)


def test_actions_stay_in_a_space_whose_bounds_float32_rounds_inwards():
    space = gym.make("Quadcopter-v0").action_space
    policy = Stabiliser(QUADCOPTER)
    generator = np.random.default_rng(0)
    box = QUADCOPTER.system.state
    actions, _ = policy.predict(box.draw(generator, 500))
    assert all(action in space for action in actions)
    assert (actions == space.high).any()


def test_rollouts_use_the_exact_controls():
    policy, p = Stabiliser(PENDULUM), np.array([[np.pi - 0.2, 0.1]])
    episodes = rollout(environments(PENDULUM, 1), policy, p, horizon=0.1, record=True)
    assert not np.array_equal(episodes.controls, episodes.controls.astype(np.float32))


@each_policy
def test_a_nan_in_an_observation_gives_a_nan_in_its_row_alone(policy):
    seen = observations(3).astype(np.float64)
    if isinstance(policy, TrackingPolicy):
        seen[:, 1] = np.nan_to_num(seen[:, 1])
    _, state = policy.predict(seen)
    seen[1, 1] = np.nan
    actions, _ = policy.predict(seen, state if isinstance(policy, TrackingPolicy) else None)
    assert np.isnan(actions).any(axis=1).tolist() == [False, True, False]


@each_policy
@pytest.mark.parametrize("far", [1e308, -1e308, np.inf, 1e30])
def test_no_finite_observation_gives_a_nan(policy, far):
    for row in ([far, 0.0], [0.0, far], [far, far]):
        actions, state = policy.predict(np.array([row, [1.0, 0.0]]))
        assert np.isfinite(actions).all()
        assert np.isfinite(policy.predict(np.array([row, [1.0, 0.0]]), state, np.zeros(2, bool))[0]).all()


@each_policy
def test_a_batch_may_be_empty(policy):
    actions, state = policy.predict(np.zeros((0, 2), np.float32))
    assert actions.shape == (0, 1)
    assert policy.predict(np.zeros((0, 2), np.float32), state, np.zeros(0, bool))[0].shape == (0, 1)


def test_no_parameters_begin_no_plan():
    policy = TrackingPolicy(DOUBLE_INTEGRATOR, rest_planner)
    assert len(policy.start(np.zeros((0, 2)))) == 0


@each_policy
@pytest.mark.parametrize(
    "observation", [[["1", "2"]], [[None, 1.0]], [1j, 0.0], [0.0], np.zeros((2, 3)), 0.0, np.zeros((1, 1, 2))]
)
def test_observations_that_are_no_numbers_or_of_another_shape_are_refused(policy, observation):
    with pytest.raises((TypeError, ValueError), match=r"observations?: expected|expected observations"):
        policy.predict(observation)


@each_policy
def test_policies_show_in_a_line_what_they_are(policy):
    assert "PendulumSwingup-v0" in repr(policy)
    assert len(repr(policy).splitlines()) == 1


def test_a_rollout_warns_of_nan_controls():
    class Broken(Stabiliser):
        def act(self, observations, state, begins):
            return np.where([[True], [False]], np.nan, super().act(observations, state, begins)[0]), None

    with pytest.warns(UserWarning, match="the policy returned NaN in 1 of 2 episodes"):
        rollout(environments(PENDULUM, 2), Broken(PENDULUM), [[1.0, 0.0], [2.0, 0.0]], horizon=0.1)


def test_rollouts_use_the_predict_of_a_subclass():
    class Idle(Stabiliser):
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.full((len(observation), 1), 0.25, np.float32), None

    episodes = rollout(environments(PENDULUM, 1), Idle(PENDULUM), [[1.0, 0.0]], horizon=0.1, record=True)
    assert (episodes.controls == 0.25).all()


def test_the_recurrent_state_of_predict_can_be_pickled():
    policy = Stabilised(Stabiliser(PENDULUM), PENDULUM)
    seen = observations(2)
    _, state = policy.predict(seen)
    again = pickle.loads(pickle.dumps(state))
    np.testing.assert_array_equal(policy.predict(seen, again)[0], policy.predict(seen, state)[0])
    assert isinstance(policy, Policy)
