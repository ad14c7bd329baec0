"""Plans that are renewed on the way."""

import dataclasses
import pickle
from functools import partial

import numpy as np
import pytest

import moe_policy
from moe_policy.checking import remedies
from moe_policy.planners.stored import StoredPlans
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers import improvement
from ocp_envs.support.sharing import Loans
from tests.closed_loop import rest_planner
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, LINEAR_QUADRATIC, WALLED_INTEGRATOR

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
P = np.array([[2.0, 0.0], [-1.0, 0.0], [0.5, 0.0]])
NO_SOLVER = moe_policy.Renewal(iterations=0, rounds=0)


@pytest.fixture(autouse=True)
def lent(monkeypatch):
    """Solvers in this process, one for each problem."""
    kept = {}
    for module in (improvement, remedies):
        monkeypatch.setattr(
            module, "lent_solvers", lambda problem: kept.setdefault(problem, Loans(partial(Solver, problem), 1))
        )


@pytest.fixture(scope="module")
def mixture():
    return moe_policy.load(PENDULUM, "moe-custom")


def rest(problem=DOUBLE_INTEGRATOR, renewal=None, **arguments):
    return moe_policy.Replanning(rest_planner, 0.2, renewal, problem=problem, **arguments)


def flown(policy, p=P, **plant):
    return moe_policy.rollout(moe_policy.environments(policy.problem, len(p), **plant), policy, p)


def after(policy, observations, steps, state=None):
    """The recurrent state after control steps at the same observations."""
    for _ in range(steps):
        _, state = policy.act(observations, state, np.zeros(len(observations), bool))
    return state


def test_without_a_solver_or_another_plan_the_old_plan_is_tracked():
    tracked = flown(moe_policy.TrackingPolicy(DOUBLE_INTEGRATOR, rest_planner))
    renewed = flown(rest(renewal=NO_SOLVER, experts=0))
    np.testing.assert_array_equal(renewed.cost, tracked.cost)
    np.testing.assert_array_equal(renewed.evaluation_time, tracked.evaluation_time)
    np.testing.assert_array_equal(renewed.plan_end_error, tracked.plan_end_error)


def test_the_solver_makes_the_rest_of_a_plan_cheaper_and_the_evaluation_follows_the_last_plan():
    tracked = flown(moe_policy.TrackingPolicy(DOUBLE_INTEGRATOR, rest_planner))
    renewed = flown(rest(experts=0))
    assert renewed.success.all()
    assert (renewed.cost[1:] < 0.99 * tracked.cost[1:]).all()
    assert (renewed.evaluation_time[1:] < tracked.evaluation_time[1:]).all()


def test_a_push_is_planned_for_from_the_state_after_it():
    policy = rest(renewal=moe_policy.Renewal(surprise=100.0), experts=0)
    state = after(policy, P, 10)
    pushed = state.plan.states[:, 2] + np.array([0.3, 0.4])
    state = after(policy, pushed, 1, state)
    np.testing.assert_allclose(state.plan.states[:, 0], pushed, atol=1e-9)
    np.testing.assert_array_equal(state.tracking.clock, 1)
    np.testing.assert_array_equal(state.clock, 11)
    np.testing.assert_allclose(state.schedule.plan_end, 0.2 + state.tracking.schedule.plan_end)


def test_after_a_push_a_plan_is_renewed_at_once():
    episodes, renewals = rest(experts=0), []
    for push in (0.0, 0.5):
        state, states = None, P.copy()
        for step in range(4):
            controls, state = episodes.act(states, state, np.zeros(3, bool))
            states = DOUBLE_INTEGRATOR.functions.flow(1)(states, controls, np.zeros((3, 0)), np.full((3, 1), 0.02))[0]
            states = states + np.array([0.0, push * (step == 2)])
        renewals.append(state.renewals.tolist())
    assert renewals == [[1, 1, 1], [2, 2, 2]]


def test_near_its_end_a_plan_that_succeeds_is_kept():
    assert (after(rest(experts=0), P, 1).renewals == 1).all()
    committed = rest(renewal=moe_policy.Renewal(commit=100.0), experts=0)
    assert after(committed, P, 1).renewals.tolist() == [0, 0, 0]


def test_another_family_has_to_save_more_than_its_part_of_the_cost(mixture):
    """The second-likeliest expert plans at first; both are tried at once. What fails in the model is left anyway."""
    p, candidates = sample(PENDULUM, 3, 200), moe_policy.Candidates(mixture)

    def flips(switch):
        renewal = moe_policy.Renewal(iterations=0, rounds=0, switch=switch)
        policy = moe_policy.Replanning(lambda p: candidates(p)[1][1], renewal=renewal, problem=PENDULUM)
        policy._renewer._candidates = candidates
        begun = policy.start(p)
        return after(policy, p, 1, dataclasses.replace(begun, clock=begun.clock + 10)).flips

    eager, reluctant = flips(0.0), flips(10.0)
    assert (reluctant <= eager).all()
    assert 0 < reluctant.sum() < eager.sum()


def test_the_first_plan_may_be_replaced_before_the_first_control_step_which_is_no_change(mixture):
    p, candidates = sample(PENDULUM, 3, 200), moe_policy.Candidates(mixture)
    policy = moe_policy.Replanning(lambda p: candidates(p)[1][1], renewal=NO_SOLVER, problem=PENDULUM)
    policy._renewer._candidates = candidates
    state = after(policy, p, 1)
    assert (state.renewals == 1).any()
    assert (state.flips == 0).all()


def test_renewals_of_a_mixture_land_where_the_plant_is_weaker(mixture):
    p = sample(PENDULUM, 7, 12)
    policy = moe_policy.Replanning(mixture, 0.4)
    tracked = flown(moe_policy.TrackingPolicy(PENDULUM, mixture), p, constants={"torque_gain": 0.85})
    renewed = flown(policy, p, constants={"torque_gain": 0.85})
    assert renewed.success.all()
    assert (renewed.plan_end_error < 0.1).sum() >= (tracked.plan_end_error < 0.1).sum()


def test_angles_in_another_turn_are_renewed_alike(mixture):
    turn = np.array([2 * np.pi, 0.0])
    policy, p = moe_policy.Replanning(mixture, 0.2), np.array([[0.5, 0.3], [5.5, -0.4]])
    one, other = after(policy, p, 11), after(policy, p + turn, 11)
    np.testing.assert_allclose(other.plan.states - turn, one.plan.states, atol=1e-7)


def test_a_planner_for_any_state_is_asked_for_the_whole_state():
    asked = []

    def planner(p):
        asked.append(p)
        return rest_planner(p)

    planner.problem = WALLED_INTEGRATOR.from_any_state
    policy = moe_policy.Replanning(planner, renewal=NO_SOLVER, problem=WALLED_INTEGRATOR)
    policy.start(np.array([[2.0, 5.0]]))
    np.testing.assert_array_equal(asked[0], [[2.0, 0.0, 5.0]])
    after(policy, np.array([[1.0, -0.5, 5.0]]), 1)
    np.testing.assert_array_equal(asked[-1], [[1.0, -0.5, 5.0]])


def test_an_episode_that_restarts_in_the_batch_begins_with_a_plan_of_its_own():
    policy = rest(experts=0)
    state = after(policy, P, 5)
    _, state = policy.act(P, state, np.array([False, True, False]))
    assert state.clock.tolist() == [6, 1, 6]
    fresh = after(policy, P[1:2], 1)
    np.testing.assert_allclose(state.plan.states[1], fresh.plan.states[0], atol=1e-9)


def test_a_planner_that_fails_leaves_the_plan_to_the_solver():
    def nothing(p):
        return DOUBLE_INTEGRATOR.unflatten(np.full((len(p), DOUBLE_INTEGRATOR.flat_size), np.nan))

    episodes = flown(moe_policy.Replanning(nothing, problem=DOUBLE_INTEGRATOR))
    assert episodes.success.all()
    assert not episodes.rejected.any()


def test_observations_that_are_nan_are_no_state_to_plan_from():
    policy, seen = rest(experts=0), P.copy()
    state = after(policy, seen, 10)
    seen[1] = np.nan
    controls, later = policy.act(seen, state, np.zeros(3, bool))
    assert np.isnan(controls[1]).all()
    assert np.isfinite(controls[[0, 2]]).all()
    np.testing.assert_array_equal(later.plan.states[1], state.plan.states[1])


def test_a_policy_travels_between_processes():
    stored = StoredPlans(P, rest_planner(P), DOUBLE_INTEGRATOR)
    policy = pickle.loads(pickle.dumps(moe_policy.Replanning(stored, experts=0)))
    np.testing.assert_array_equal(after(policy, P, 2).clock, 2)


def test_a_duration_that_is_given_cannot_be_renewed():
    fixed = dataclasses.replace(LINEAR_QUADRATIC, duration=(5.0, 5.0))
    with pytest.raises(ValueError, match="its duration is given, so that the rest of a plan is no plan"):
        rest(problem=fixed)


@pytest.mark.parametrize("arguments", [{"every": 0.0}, {"every": -1.0}])
def test_times_are_positive(arguments):
    with pytest.raises(ValueError, match="every: expected a positive number of seconds"):
        moe_policy.Replanning(rest_planner, problem=DOUBLE_INTEGRATOR, **arguments)


@pytest.mark.parametrize("name", ["margin", "switch", "commit", "surprise"])
def test_settings_are_not_negative(name):
    with pytest.raises(ValueError, match=f"{name}: expected at least 0, got -1"):
        moe_policy.Renewal(**{name: -1.0})
