"""The rollout loop against replays by hand, closed forms, and policies that misbehave."""

import numpy as np
import pytest
from gymnasium.vector import VectorWrapper
from gymnasium.wrappers import vector as vector_wrappers

from moe_policy.control.stabiliser import Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.protocols import Schedule
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from ocp_envs import Env, VectorEnv
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.solvers.guesses import guesses
from ocp_envs.trajectory import Trajectory
from tests.closed_loop import PARAMETERS, constant, rest_planner, vector
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, rest_to_rest


def test_exact_plan_ends_at_the_goal_with_the_cost_of_the_closed_form():
    envs = vector(DOUBLE_INTEGRATOR, 3)
    episodes = rollout(envs, TrackingPolicy(DOUBLE_INTEGRATOR, rest_planner), PARAMETERS, record=True)
    assert episodes.success.all()
    assert episodes.reached.all()
    np.testing.assert_allclose(episodes.plan_end_error, 0, atol=1e-6)
    np.testing.assert_allclose(episodes.evaluation_time, 6.0)
    force = PARAMETERS[:, 0] / 4
    np.testing.assert_allclose(episodes.cost, episodes.entry_time * (1 + force**2 / 2), rtol=1e-5)
    # On the way in x = a/2 τ², v = −a τ with τ to go, so the ball is entered at τ² (τ²/4 + 1) a² = radius².
    a = np.abs(force)
    tau = np.sqrt(2 * (np.sqrt(1 + DOUBLE_INTEGRATOR.goal.radius**2 / a**2) - 1))
    assert np.all((episodes.entry_time >= 4 - tau - 1e-6) & (episodes.entry_time <= 4 - tau + 0.02))
    assert episodes.states.shape == (3, 301, 2)
    assert episodes.controls.shape == (3, 300, 1)
    np.testing.assert_allclose(episodes.states[:, 200], 0, atol=1e-6)


def test_an_exact_plan_replayed_open_loop_through_the_simulator_gives_its_states_and_cost():
    plan = rest_planner(PARAMETERS)
    simulator = Simulator(DOUBLE_INTEGRATOR, 0.2, DOUBLE_INTEGRATOR.substeps)
    x, cost = plan.states[:, 0], np.zeros(3)
    for i in range(20):
        step = simulator.advance(x, plan.controls[:, i], np.zeros((3, 0)))
        x, cost = step.states, cost + step.cost
        np.testing.assert_allclose(x, plan.states[:, i + 1], atol=1e-12)
    np.testing.assert_allclose(cost, 4 * (1 + (PARAMETERS[:, 0] / 4) ** 2 / 2), rtol=1e-12)


def test_solved_plans_replay_through_the_simulator_and_track_to_the_goal():
    """The transcription and the simulation never meet; their steps are the same all the same."""
    rng = np.random.default_rng(4)
    p = rng.uniform(PENDULUM.parameters.lower, PENDULUM.parameters.upper, (12, 2))
    windings = np.ones(len(p), np.int64)
    solutions = Solver(PENDULUM).solve(p, guesses(PENDULUM, p, windings, rng), windings)
    p, plan, cost = (values[solutions.solved] for values in (p, solutions.trajectory, solutions.cost))
    assert len(p) >= 8
    for row in range(len(p)):
        simulator = Simulator(PENDULUM, plan.step[row], PENDULUM.substeps)
        x, paid = plan.states[row, :1], 0.0
        for i in range(PENDULUM.knots - 1):
            step = simulator.advance(x, plan.controls[row, i : i + 1], np.zeros((1, 0)))
            x, paid = step.states, paid + step.cost[0]
            np.testing.assert_allclose(x[0], plan.states[row, i + 1], atol=1e-4)
        np.testing.assert_allclose(paid, cost[row], rtol=1e-5)
    episodes = rollout(vector(PENDULUM, len(p)), TrackingPolicy(PENDULUM, lambda _: plan), p)
    assert episodes.success.all()
    assert episodes.plan_end_error.max() < 1e-3


def test_batches_do_not_change_the_episodes():
    policy = TrackingPolicy(DOUBLE_INTEGRATOR, rest_planner)
    one = rollout(vector(DOUBLE_INTEGRATOR, 3), policy, PARAMETERS, record=True)
    two = rollout(vector(DOUBLE_INTEGRATOR, 2), policy, PARAMETERS, record=True)
    for name in Episodes.__dataclass_fields__:
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), atol=1e-9, err_msg=name)


def test_rows_agree_with_single_environments_stepped_by_hand():
    policy = Stabiliser(PENDULUM)
    p = np.array([[2.5, 0.3], [4.0, -0.5], [0.4, 0.0], [np.pi + 0.01, 0.0]])
    episodes = rollout(vector(PENDULUM, 4), policy, p)
    for row, parameter in enumerate(p):
        env = Env(PENDULUM, terminate_at_goal=False)
        observation, _ = env.reset(options={"parameters": parameter})
        cost, entry = 0.0, 0 if PENDULUM.goal_error(env.state) < 0.1 else None
        for k in range(1000):
            if entry is not None and k == entry + 250:
                break
            observation, reward, _, _, info = env.step(policy.predict(observation)[0])
            if entry is None:
                cost -= reward
                entry = k + 1 if info["is_success"] else None
        assert episodes.reached[row] == (entry is not None)
        assert episodes.success[row] == (PENDULUM.goal_error(env.state) < 0.1)
        np.testing.assert_allclose(episodes.cost[row], cost, rtol=1e-6)
        np.testing.assert_allclose(episodes.final_error[row], PENDULUM.goal_error(env.state), atol=1e-5)
        expected = 20.0 if entry is None else min(entry * 0.02 + 5.0, 20.0)
        np.testing.assert_allclose(episodes.evaluation_time[row], expected)


def test_an_initial_state_in_the_goal_ball_costs_nothing_and_is_evaluated_after_the_hold():
    episodes = rollout(vector(PENDULUM, 1), Stabiliser(PENDULUM), [[np.pi, 0.01]])
    assert episodes.success.all()
    assert episodes.cost[0] == 0
    assert episodes.entry_time[0] == 0
    assert episodes.evaluation_time[0] == 5.0


def test_planning_policies_get_the_parameter_in_full_precision():
    seen = []

    def planner(p):
        seen.append(p.copy())
        return rest_planner(p)

    p = np.array([[1 / 3, 0.1]])
    rollout(vector(DOUBLE_INTEGRATOR, 1), TrackingPolicy(DOUBLE_INTEGRATOR, planner), p)
    np.testing.assert_array_equal(seen[0], p)
    assert len(seen) == 1


def test_wrapped_environments_are_accepted():
    class Halved(VectorWrapper):
        def step(self, actions):
            return self.env.step(actions / 2)

    policy = constant(1.0)
    episodes = rollout(Halved(vector(DOUBLE_INTEGRATOR, 1)), policy, [[0.0, 1.0]], horizon=1.0, record=True)
    np.testing.assert_allclose(episodes.states[0, 1], [0.02 + 0.5 * 0.02**2 / 2, 1.01])


class EndsAtOnce(VectorWrapper):
    def step(self, actions):
        observations, rewards, terminated, truncated, _ = self.env.step(actions)
        return observations, rewards, ~terminated, ~truncated, {}


class Repeats(VectorWrapper):
    def step(self, actions):
        self.env.step(actions)
        return self.env.step(actions)


def scaled_rewards(envs):
    return vector_wrappers.TransformReward(envs, lambda reward: 0.1 * reward.astype(np.float32))


@pytest.mark.parametrize(
    "wrapper", [scaled_rewards, EndsAtOnce, vector_wrappers.NormalizeReward, vector_wrappers.RecordEpisodeStatistics]
)
def test_no_wrapper_of_rewards_and_ends_changes_an_episode(wrapper):
    p = np.array([[2.5, 0.3], [4.0, -0.5], [6.0, 2.0]])
    plain, wrapped = (
        rollout(envs, Stabiliser(PENDULUM), p) for envs in (vector(PENDULUM, 3), wrapper(vector(PENDULUM, 3)))
    )
    for name in Episodes.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(wrapped, name), getattr(plain, name), err_msg=name)


def test_costs_are_the_rewards_of_the_environment_bit_by_bit():
    envs = vector(PENDULUM, 1)
    episodes = rollout(envs, constant(0.7), [[1.0, 0.5]], horizon=0.5)
    envs.reset(options={"parameters": [1.0, 0.5]})
    assert episodes.cost[0] == sum(-envs.step(np.full((1, 1), np.float32(0.7)))[1][0] for _ in range(25))


def test_recorded_controls_are_those_that_the_environment_gets():
    halved = vector_wrappers.TransformAction(vector(PENDULUM, 1), lambda actions: actions / 2)
    episodes = rollout(halved, constant(0.5), [[1.0, 0.5]], horizon=0.1, record=True)
    np.testing.assert_array_equal(episodes.controls, np.full((1, 5, 1), 0.25))


def test_wrappers_that_repeat_actions_are_refused():
    with pytest.raises(
        ValueError, match=r"one control step of 0\.02 s; after 1 of them an episode is at control step 2"
    ):
        rollout(Repeats(vector(PENDULUM, 2)), constant(0.0), [[1.0, 0.5], [2.0, 0.0]])


def test_refusals():
    policy = constant(0.0)
    with pytest.raises(ValueError, match="same dt"):
        rollout(vector(PENDULUM, 1), Stabiliser(PENDULUM, dt=0.05), [[0.0, 0.0]])
    with pytest.raises(ValueError, match="terminate_at_goal=False"):
        rollout(VectorEnv(PENDULUM, 1, autoreset_mode="Disabled"), policy, [[0.0, 0.0]])
    with pytest.raises(ValueError, match="Disabled"):
        rollout(VectorEnv(PENDULUM, 1, terminate_at_goal=False), policy, [[0.0, 0.0]])
    with pytest.raises(ValueError, match="horizon"):
        rollout(vector(PENDULUM, 1), policy, [[0.0, 0.0]], horizon=50.0)
    with pytest.raises(ValueError, match="finite"):
        rollout(vector(PENDULUM, 1), policy, [[np.nan, 0.0]])
    with pytest.raises(ValueError, match="shape"):
        rollout(vector(PENDULUM, 1), policy, [[0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="at least one"):
        rollout(vector(PENDULUM, 1), policy, np.zeros((0, 2)))


def test_parameters_outside_their_box_are_run():
    episodes = rollout(vector(PENDULUM, 1), Stabiliser(PENDULUM), [[7.0, 3.0]], horizon=0.1)
    assert len(episodes) == 1


def test_stable_baselines_evaluates_the_tracking_policy():
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    from stable_baselines3.common.monitor import Monitor

    env = Monitor(Env(DOUBLE_INTEGRATOR))
    policy = TrackingPolicy(DOUBLE_INTEGRATOR, lambda p: Trajectory(*rest_to_rest(p[:, 0], 6.0, 21)))
    rewards, lengths = evaluation.evaluate_policy(policy, env, n_eval_episodes=4, return_episode_rewards=True)
    assert len(rewards) == 4
    assert max(lengths) < 450  # ended in the goal ball, not at the limit of 750


def test_the_schedule_is_all_the_loop_knows_of_a_plan():
    size = 2
    schedule = Schedule(
        plan_end=np.array([1.0, 0.5]),
        evaluation=np.array([1.5, 0.5]),
        knot_step=np.full(size, 0.1),
        clipped=np.zeros(size, bool),
        rejected=np.zeros(size, bool),
    )
    policy = constant(0.0, start=lambda p: None, schedule=lambda state: schedule)
    episodes = rollout(vector(DOUBLE_INTEGRATOR, 2), policy, [[1.0, -1.0], [1.0, 0.0]])
    np.testing.assert_allclose(episodes.evaluation_time, [1.5, 0.5])
    np.testing.assert_allclose(episodes.plan_end_error, [1.0, 1.0])
    np.testing.assert_allclose(episodes.final_error, [np.hypot(0.5, 1), 1.0])


def test_evaluated_at_the_goal_a_plan_is_charged_up_to_the_time_limit():
    """A vehicle that stands where it is, at a cost rate of 10, with a plan of one second."""
    state = np.array([[5.0, 5.0, 0.0, 0.0]])
    states = np.tile(state[:, None], (1, VEHICLE.knots, 1))
    plan = Trajectory(states, np.zeros((1, VEHICLE.knots - 1, 2)), np.array([1.0]))
    policy, envs = TrackingPolicy(VEHICLE, lambda p: plan), vector(VEHICLE, 1)
    assert rollout(envs, policy, state).cost == pytest.approx(10.0)
    episodes = rollout(envs, policy, state, evaluation="goal")
    assert episodes.cost == pytest.approx(10.0 * VEHICLE.time_limit)
    assert np.isnan(episodes.plan_end_error).all()
    with pytest.raises(ValueError, match=r"evaluation: expected one of 'schedule', 'goal', got 'end'"):
        rollout(envs, policy, state, evaluation="end")
