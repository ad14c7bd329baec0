"""Actors, and policies that act at their own period."""

import json

import numpy as np
import pytest

from moe_policy import store
from moe_policy.control.stabiliser import Stabilised
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.pendulum import PENDULUM
from tests.learners import make_envs, observations, random_actor, random_policy


@pytest.mark.parametrize(
    ("activation", "squash", "function", "bounded"),
    [("tanh", "clip", np.tanh, lambda a: np.clip(a, -1, 1)), ("relu", "tanh", lambda x: np.maximum(x, 0), np.tanh)],
)
def test_an_actor_computes_its_formula(activation, squash, function, bounded):
    actor = random_actor([3, 4, 2], activation, squash)
    (w1, w2), (b1, b2) = actor.weights, actor.biases
    x = np.random.default_rng(0).standard_normal((50, 3)).astype(np.float32) * 5
    np.testing.assert_allclose(actor(x), bounded(function(x @ w1.T + b1) @ w2.T + b2), atol=1e-6)


@pytest.mark.parametrize(
    ("sizes", "activation", "squash", "message"),
    [
        ([3], "relu", "tanh", "at least one layer"),
        ([3, 1], "gelu", "tanh", r"an activation of \['relu', 'tanh'\]"),
        ([3, 1], "relu", "none", r"a squash of \['clip', 'tanh'\]"),
    ],
)
def test_an_actor_of_unknown_parts_is_refused(sizes, activation, squash, message):
    with pytest.raises(ValueError, match=message):
        random_actor(sizes, activation, squash)


def test_a_decision_is_held_for_a_period_in_every_row_by_itself():
    policy, state = random_policy(), None
    decided = np.zeros((3, 1))
    ages = np.zeros(3, int)
    for k in range(23):
        seen = observations(3, seed=k)
        start = np.array([k == 0, k in (0, 7), k in (0, 12, 13)])
        ages[start] = 0
        controls, state = policy.act(seen, state, start)
        due = ages % 5 == 0
        decided[due] = policy.controls(seen)[due]
        np.testing.assert_allclose(controls, decided, atol=1e-6)  # a batch of another size is rounded differently
        ages += 1


def test_one_observation_or_a_batch_of_one():
    policy, seen = random_policy(), observations(1)
    single, state = policy.predict(seen[0])
    batch, _ = policy.predict(seen)
    assert single.shape == (1,)
    np.testing.assert_array_equal(single, batch[0])
    again, _ = policy.predict(seen[0] + np.float32(0.01), state=state)
    np.testing.assert_array_equal(again, single)


def test_the_hold_reproduces_the_environment_the_learner_saw():
    """Five held control steps of 0.02 s are one step of 0.1 s, so states and costs agree at the decisions."""
    policy = random_policy()
    fine, coarse = make_envs(PENDULUM, 5), make_envs(PENDULUM, 5, dt=0.1)
    p = np.array([[0.1, 0.0], [2.0, 1.0], [3.0, -1.0], [4.5, 2.0], [6.0, -2.0]])
    seen_fine, _ = fine.reset(options={"parameters": p})
    seen_coarse, _ = coarse.reset(options={"parameters": p})
    slow, state_fine, state_coarse = policy.at(0.1), None, None
    for _ in range(40):
        cost = 0.0
        for _ in range(5):
            controls, state_fine = policy.predict(seen_fine, state=state_fine)
            seen_fine, reward, *_ = fine.step(controls)
            cost = cost - reward
        controls, state_coarse = slow.predict(seen_coarse, state=state_coarse)
        seen_coarse, reward, *_ = coarse.step(controls)
        np.testing.assert_allclose(fine.unwrapped.state, coarse.unwrapped.state, atol=1e-5)
        np.testing.assert_allclose(cost, -reward, atol=1e-5)


def test_a_period_must_be_a_multiple_of_the_control_period():
    with pytest.raises(ValueError, match=r"decides every 0\.1 s, which is no multiple of the control period of 0\.03"):
        random_policy(dt=0.03)
    with pytest.raises(ValueError, match="no multiple"):
        random_policy().at(0.2)
    with pytest.raises(ValueError, match="dt must be a positive number"):
        random_policy(dt=0.0)


def test_a_recurrent_state_of_other_episodes_and_a_foreign_actor_are_refused():
    policy = random_policy()
    _, state = policy.predict(observations(3))
    with pytest.raises(ValueError, match="2 observations with the recurrent state of 3"):
        policy.predict(observations(2), state=state)
    with pytest.raises(ValueError, match="from 3 features to 1 actions"):
        LearnedPolicy(PENDULUM, random_actor([4, 1]), period=0.1)


def test_a_damaged_or_foreign_policy_file_is_refused(tmp_path):
    path = tmp_path / "sac"
    random_policy(details={"note": "x"}).save(path)
    loaded = store.load_file(path)
    assert (loaded.period, loaded.dt, loaded.algorithm, loaded.details) == (0.1, 0.02, "sac", {"note": "x"})
    assert loaded.parameters_total == 3 * 8 + 8 + 8 + 1
    with pytest.raises(store.ModelFileError, match="not for"):
        store.load_file(path, PENDULUM.with_constants(mass=2.0))
    description = json.loads((tmp_path / "sac.json").read_text())
    (tmp_path / "sac.json").write_text(json.dumps({**description, "sizes": [3, 9, 1]}))
    with pytest.raises(store.ModelFileError, match="checksum of its content differs"):
        store.load_file(path)
    (tmp_path / "sac.json").write_text(json.dumps(description))
    (tmp_path / "sac.safetensors").write_bytes((tmp_path / "sac.safetensors").read_bytes()[:-7])
    with pytest.raises(store.ModelFileError, match="truncated"):
        store.load_file(path)


def test_the_shipped_policy_is_a_fair_opponent():
    box = PENDULUM.parameters
    p = np.random.default_rng(99).uniform(box.lower, box.upper, (1000, 2))
    policy = store.load(PENDULUM.id, "sac")
    episodes = rollout(make_envs(PENDULUM, 1000), Stabilised(policy, PENDULUM), p)
    assert episodes.success.sum() >= 950
