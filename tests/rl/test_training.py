"""Actors rebuilt from their tensors, policies at their own pace, and short trainings."""

import dataclasses
import json
import sys

import gymnasium as gym
import numpy as np
import pytest
import torch

import ocp_envs
from moe_policy import store
from moe_policy.control.tracking import Stabilised
from moe_policy.rl.actor import Actor, LearnedPolicy
from moe_policy.rl.settings import PPOSettings, SACSettings, TQCSettings
from moe_policy.rl.training import figures_of, train, training_env
from moe_policy.rl.wrappers import Features
from moe_policy.rollouts.rollout import rollout
from ocp_envs.goal import Goal
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.system import Box, Coordinate
from tests.small_problems import DOUBLE_INTEGRATOR

SAC = SACSettings(steps=400, learning_starts=200, gradient_steps=1, n_envs=4, hidden=(8, 16), evaluate_every=200)
PPO = PPOSettings(steps=512, n_envs=8, n_steps=16, batch_size=64, n_epochs=2, hidden=(8, 16), evaluate_every=256)
TQC = TQCSettings(**dataclasses.asdict(SAC), dropped=3)
DEVELOPMENT = np.array([[0.5, 0.5], [3.0, 0.0], [3.2, 0.05], [5.0, -1.0]])


def make_envs(problem, count, **arguments):
    return gym.make_vec(problem.id, num_envs=count, terminate_at_goal=False, autoreset_mode="Disabled", **arguments)


def random_policy(**arguments):
    torch.manual_seed(0)
    return LearnedPolicy(PENDULUM, Actor([3, 8, 1], "relu", "tanh"), period=0.1, **arguments)


def observations(count, seed=0):
    box = PENDULUM.system.state
    return box.draw(np.random.default_rng(seed), count).astype(np.float32)


# -- the actor ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [SAC, PPO, TQC], ids=["sac", "ppo", "tqc"])
def test_the_rebuilt_actor_does_what_stable_baselines_does(settings, tmp_path):
    if settings is TQC:
        pytest.importorskip("sb3_contrib")
    learner = settings.learner(training_env(PENDULUM, settings))
    learner.learn(settings.steps)
    policy = LearnedPolicy(PENDULUM, settings.actor(learner), period=0.1, algorithm=settings.algorithm)
    policy.save(tmp_path / "rl")
    seen = observations(200)
    expected, _ = learner.predict(Features(PENDULUM)(seen), deterministic=True)
    assert np.ptp(expected) > 1e-3, "a constant would prove nothing"
    for candidate in (policy, store.load_file(tmp_path / "rl")):
        np.testing.assert_allclose(candidate.controls(seen), expected, atol=2e-6)


def test_the_first_actions_of_ppo_are_about_the_goals_control():
    """A quadcopter that begins with half thrust rises at once; one that hovers has time to learn."""
    settings = dataclasses.replace(PPO, hidden=(64, 64))
    learner = settings.learner(training_env(QUADCOPTER, settings))
    policy = LearnedPolicy(QUADCOPTER, settings.actor(learner), period=0.1, algorithm="ppo")
    np.testing.assert_allclose(policy.controls(np.zeros((1, 12))), [QUADCOPTER.goal.control], atol=0.1)


def test_an_actor_computes_its_formula():
    torch.manual_seed(1)
    actor = Actor([3, 4, 2], "tanh", "clip")
    (w1, b1), (w2, b2) = [(layer.weight.detach().numpy(), layer.bias.detach().numpy()) for layer in actor.layers]
    x = np.random.default_rng(0).standard_normal((50, 3)).astype(np.float32) * 5
    expected = np.clip(np.tanh(x @ w1.T + b1) @ w2.T * 3 + b2 * 3, -1, 1)
    with torch.no_grad():
        actor.layers[-1].weight *= 3
        actor.layers[-1].bias *= 3
        np.testing.assert_allclose(actor(torch.from_numpy(x)).numpy(), expected, atol=1e-6)


@pytest.mark.parametrize("arguments", [([3], "relu", "tanh"), ([3, 1], "gelu", "tanh"), ([3, 1], "relu", "none")])
def test_an_actor_of_unknown_parts_is_refused(arguments):
    with pytest.raises(ValueError, match="expected at least two sizes"):
        Actor(*arguments)


# -- the policy at its own pace ----------------------------------------------------------------------------------------


def test_a_decision_is_held_for_a_period_in_every_row_by_itself():
    policy, state = random_policy(), None
    decided = np.zeros((3, 1))
    ages = np.zeros(3, int)
    for tick in range(23):
        seen = observations(3, seed=tick)
        start = np.array([tick == 0, tick in (0, 7), tick in (0, 12, 13)])
        ages[start] = 0
        controls, state = policy.predict(seen, state=state, episode_start=start)
        due = ages % 5 == 0
        decided[due] = policy.controls(seen)[due]
        np.testing.assert_array_equal(controls, decided)
        ages += 1


def test_one_observation_or_a_batch_of_one():
    policy, seen = random_policy(), observations(1)
    single, state = policy.predict(seen[0])
    batch, _ = policy.predict(seen)
    assert single.shape == (1,)
    np.testing.assert_array_equal(single, batch[0])
    again, _ = policy.predict(observations(1, seed=9)[0], state=state)
    np.testing.assert_array_equal(again, single)


def test_the_hold_reproduces_the_environment_the_learner_saw():
    """Five held ticks of 0.02 s are one step of 0.1 s, so states and costs agree at the decisions."""
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
    with pytest.raises(ValueError, match="no multiple"):
        random_policy(dt=0.0)


def test_a_recurrent_state_of_other_episodes_and_a_foreign_actor_are_refused():
    policy = random_policy()
    _, state = policy.predict(observations(3))
    with pytest.raises(ValueError, match="2 observations with the recurrent state of 3"):
        policy.predict(observations(2), state=state)
    with pytest.raises(ValueError, match="from 3 features to 1 actions"):
        LearnedPolicy(PENDULUM, Actor([4, 1], "relu", "tanh"), period=0.1)


# -- files -------------------------------------------------------------------------------------------------------------


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
    with pytest.raises(store.ModelFileError, match="do not fit together"):
        store.load_file(path)
    (tmp_path / "sac.json").write_text(json.dumps(description))
    (tmp_path / "sac.safetensors").write_bytes((tmp_path / "sac.safetensors").read_bytes()[:-7])
    with pytest.raises(store.ModelFileError, match="truncated"):
        store.load_file(path)


# -- training ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [SAC, PPO], ids=["sac", "ppo"])
def test_training_reports_and_keeps_the_best(settings):
    reports = []
    optimal = np.array([4.0, 0.3, 0.1, 3.0])
    run = train(PENDULUM, settings, DEVELOPMENT, optimal_costs=optimal, on_evaluation=reports.append)
    assert [e.steps for e in run.curve] == [settings.evaluate_every, 2 * settings.evaluate_every]
    assert [len(r.curve) for r in reports] == [1, 2]
    assert run.best.score == min(e.score for e in run.curve)
    assert not any(evaluation.better_than(run.best) for evaluation in run.curve)
    assert run.policy.details["steps"] == run.best.steps
    record = json.loads(json.dumps(run.record(), allow_nan=False))
    assert record["settings"]["steps"] == settings.steps
    assert record["curve"][-1]["seconds"] > 0
    episodes = rollout(make_envs(PENDULUM, 4), Stabilised(run.policy, PENDULUM), DEVELOPMENT)
    failed = 2 * PENDULUM.time_limit  # the largest cost rate of the pendulum is 2
    assert run.best.score == pytest.approx(np.where(episodes.success, episodes.cost, failed).mean())
    assert run.best.success == episodes.success.sum()
    assert run.best.mean_return == pytest.approx(-episodes.cost.mean())
    assert run.best.violation is None
    if episodes.success.any():
        ratio = episodes.cost[episodes.success].sum() / optimal[episodes.success].sum()
        assert run.best.cost_ratio == pytest.approx(ratio)


def test_figures_of_episodes_add_up():
    """From hand-made episodes: two successes, one that entered the goal ball and left it, one that left the box."""
    policy = Stabilised(random_policy(), PENDULUM)
    episodes = dataclasses.replace(
        rollout(make_envs(PENDULUM, 4), policy, DEVELOPMENT),
        success=np.array([True, True, False, False]),
        reached=np.array([True, True, True, False]),
        cost=np.array([2.0, 4.0, 1.0, 40.0]),
    )
    figures = figures_of(PENDULUM, episodes, np.array([1.0, 4.0, 100.0, 100.0]))
    assert figures == {
        "success": 2,
        "reached": 3,
        "cost": 3.0,
        "score": (2.0 + 4.0 + 40.0 + 40.0) / 4,
        "cost_ratio": 6.0 / 5.0,
        "mean_return": -47.0 / 4,
        "violation": None,
        "final_error": float(np.median(episodes.final_error)),
    }
    none = figures_of(PENDULUM, dataclasses.replace(episodes, success=np.zeros(4, bool)), np.ones(4))
    assert (none["cost"], none["cost_ratio"]) == (None, None)
    assert figures_of(PENDULUM, episodes)["cost_ratio"] is None


@pytest.mark.parametrize("costs", [np.ones(3), np.array([1.0, 1.0, 0.0, 1.0]), np.array([1.0, np.nan, 1.0, 1.0])])
def test_optimal_costs_must_be_one_a_start_and_positive(costs):
    with pytest.raises(ValueError, match="one positive optimal cost for each of 4"):
        train(PENDULUM, SAC, DEVELOPMENT, optimal_costs=costs)


def test_the_return_of_an_evaluation_is_what_the_environment_charges():
    """Summed in the environment itself, at the control period of the judge, with the goal as its end."""
    policy = random_policy()
    judged = rollout(make_envs(PENDULUM, 4), Stabilised(policy, PENDULUM), DEVELOPMENT)
    env, returns = gym.make(PENDULUM.id), []
    for p in DEVELOPMENT:
        observation, _ = env.reset(options={"parameters": p})
        state, over, total = None, bool(PENDULUM.goal_error(p) < PENDULUM.goal.radius), 0.0
        while not over:
            action, state = policy.predict(observation, state=state)
            observation, reward, terminated, truncated, _ = env.step(action)
            over, total = terminated or truncated, total + reward
        returns.append(total)
    assert figures_of(PENDULUM, judged)["mean_return"] == pytest.approx(np.mean(returns), abs=1e-4)


def test_tqc_tells_what_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    with pytest.raises(ImportError, match=r"pip install 'ocp-moe\[tqc\]'"):
        train(PENDULUM, TQC, DEVELOPMENT)


def test_training_is_reproducible():
    runs = [train(PENDULUM, SAC, DEVELOPMENT) for _ in range(2)]
    states = [run.policy.actor.state_dict() for run in runs]
    for name in states[0]:
        torch.testing.assert_close(states[0][name], states[1][name], rtol=0, atol=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gamma": 1.5}, "gamma"),
        ({"steps": 0}, "steps"),
        ({"final_learning_rate": 1.0}, "final_learning_rate"),
        ({"largest_cost": 0.0}, "largest_cost"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        SACSettings(**change)


#: A goal wide enough to be found by chance, so that what is tested is the learning and not the exploration.
WIDE_GOAL = dataclasses.replace(
    DOUBLE_INTEGRATOR,
    id="WideGoal-v0",
    parameters=Box((Coordinate("x", -2.0, 2.0, "m"), Coordinate("v", -0.5, 0.5, "m/s"))),
    goal=Goal(state=[0.0, 0.0], radius=0.4, windings=[[0, 0]], control=[0.0]),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        SACSettings(steps=12_000, learning_starts=2_000, evaluate_every=3_000),
        PPOSettings(steps=150_000, evaluate_every=50_000),
    ],
    ids=["sac", "ppo"],
)
def test_both_learners_move_a_mass_and_stop(settings):
    ocp_envs.register(WIDE_GOAL)
    box = WIDE_GOAL.parameters
    development = np.random.default_rng(0).uniform(box.lower, box.upper, (100, 2))
    assert train(WIDE_GOAL, settings, development).best.success >= 95


# -- what is shipped ---------------------------------------------------------------------------------------------------


def test_the_shipped_policy_is_a_fair_opponent():
    box = PENDULUM.parameters
    p = np.random.default_rng(99).uniform(box.lower, box.upper, (1000, 2))
    policy = store.load(PENDULUM.id, "sac")
    episodes = rollout(make_envs(PENDULUM, 1000), Stabilised(policy, PENDULUM), p)
    assert episodes.success.sum() >= 950
