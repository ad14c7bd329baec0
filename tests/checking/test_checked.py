"""Plans are verified, repaired, solved or withheld; the solver runs in this process."""

from functools import partial

import numpy as np
import pytest

import moe_policy
from moe_policy.checking import remedies
from moe_policy.checking.candidates import Candidates
from moe_policy.checking.checked import BestOf, Checked, blocks
from moe_policy.checking.remedies import Repair
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers import improvement
from ocp_envs.support.sharing import Loans
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.solvers.programs import DISC

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
P = np.array([[-3.0, 0.4, 1.0], [-4.0, -0.3, 0.8], [3.0, 2.5, 1.5], [-2.0, 2.0, 1.0]])
KEPT = {problem.id: Loans(partial(Solver, problem), 1) for problem in (DISC, PENDULUM)}


@pytest.fixture(autouse=True)
def solvers(monkeypatch):
    for module in (improvement, remedies):
        monkeypatch.setattr(module, "lent_solvers", lambda problem: KEPT[problem.id])


def no_solver(monkeypatch):
    for module in (improvement, remedies):
        monkeypatch.setattr(module, "lent_solvers", lambda problem: pytest.fail("nothing is solved"))


def straight(p):
    """Straight through the disc, at rest at neither end: a plan that fails unless the way is free."""
    states, _ = DISC.start(np.atleast_2d(p))
    progress = np.linspace(0, 1, DISC.knots)[:, None]
    line = states[:, None] * (1 - progress) + DISC.goal.state * progress
    line[:, :, 2:] = (DISC.goal.state[:2] - states[:, :2])[:, None] / 4.0
    return Trajectory(line, np.zeros((len(line), DISC.knots - 1, 2)), np.full(len(line), 4.0))


def nothing(p):
    return DISC.unflatten(np.full((len(p), DISC.flat_size), np.nan))


def flown(problem, p, plans):
    policy = moe_policy.TrackingPolicy(problem, moe_policy.StoredPlans(p, plans))
    return moe_policy.rollout(moe_policy.environments(problem, len(p)), policy, p)


def assert_verified(problem, p, checked):
    """What is verified succeeds, and costs what was predicted."""
    episodes, good = flown(problem, p, checked.trajectory), checked.verified
    assert (episodes.plan_end_error[good] < problem.goal.radius).all()
    assert not episodes.left_box[good].any()
    assert (np.nan_to_num(np.maximum(episodes.violation, episodes.knot_violation))[good] == 0).all()
    np.testing.assert_allclose([v.cost for v in checked.verdicts if v.verified], episodes.cost[good], rtol=1e-9)


def test_plans_that_succeed_in_the_model_stay_as_they_are(monkeypatch):
    no_solver(monkeypatch)
    planner, p = moe_policy.load(PENDULUM, "moe-custom"), sample(PENDULUM, 5, 30)
    checked = Checked(planner).check(p)
    assert checked.count("chosen") == len(p)
    assert_verified(PENDULUM, p, checked)
    chosen = BestOf(Candidates(planner))
    np.testing.assert_array_equal(chosen(p).flat(), checked.trajectory.flat())
    assert chosen.name == "moe-custom, best of 2"
    assert {verdict.source for verdict in checked.verdicts} <= {f"moe-custom, expert {i}" for i in range(10)}
    assert all(verdict.reason == "" and verdict.milliseconds > 0 for verdict in checked.verdicts)


def test_the_best_of_all_experts_fails_less_often_than_the_likeliest():
    planner, p = moe_policy.load(PENDULUM, "moe-custom"), sample(PENDULUM, 6, 200)
    errors = [flown(PENDULUM, p, each(p)).plan_end_error for each in (planner, BestOf(Candidates(planner, 2)))]
    failures = [(error >= PENDULUM.goal.radius).sum() for error in errors]
    assert failures[1] == 0 < failures[0]


def test_plans_that_fail_are_repaired_until_the_tracked_path_is_clear():
    planner = Checked(straight, problem=DISC, repair=Repair(8, 4))
    checked = planner.check(P)
    assert checked.verified.all()
    assert_verified(DISC, P, checked)
    assert checked.count("repaired") >= 3
    assert all(verdict.clearance > 0 for verdict in checked.verdicts)
    np.testing.assert_allclose(planner(P).flat(), checked.trajectory.flat())
    assert planner.name == "planner, checked"


def test_what_cannot_be_repaired_is_solved_from_every_candidate():
    checked = Checked(straight, problem=DISC, repair=Repair(1, rounds=0, margin=0.1)).check(P)
    assert checked.count("solved") + checked.count("chosen") == len(P)
    assert checked.count("solved") >= 3
    assert_verified(DISC, P, checked)


def test_the_nearest_solution_is_one_more_guess():
    planner = Checked(nothing, problem=DISC, nearest=straight, repair=Repair(margin=0.1))
    checked = planner.check(P)
    assert checked.count("solved") == len(P)
    assert_verified(DISC, P, checked)


def test_where_nothing_is_verified_there_is_no_plan_and_a_reason(monkeypatch):
    p = np.array([[0.5, 0.0, 1.0], [-3.0, 0.4, 1.0]])
    checked = Checked(straight, problem=DISC, repair=Repair(8, 4)).check(p)
    assert checked.trajectory.finite.tolist() == [False, True]
    first, second = checked.verdicts
    assert (first.how, first.verified, second.verified) == ("abstained", False, True)
    assert first.reason == "clearance 0 is -0.5, less than 0, at knot 0, the initial state"
    no_solver(monkeypatch)
    kept = Checked(straight, problem=DISC, abstain=False).check(p[:1])
    assert kept.trajectory.finite.all()
    assert (kept.verdicts[0].how, kept.verdicts[0].verified) == ("chosen", False)
    assert kept.verdicts[0].reason == first.reason


def test_plans_of_a_planner_that_fails_are_none(monkeypatch):
    checked = Checked(nothing, problem=DISC).check(P[:1])
    assert checked.count("abstained") == 1
    assert checked.verdicts[0].reason == "there is no plan that is finite"


def test_plans_do_not_depend_on_the_batch_or_on_the_turn():
    planner, p = Checked(moe_policy.load(PENDULUM, "moe-custom")), sample(PENDULUM, 5, 6)
    whole = planner(p).flat()
    np.testing.assert_allclose(np.concatenate([planner(row).flat() for row in p]), whole, atol=1e-5)
    turn = np.array([2 * np.pi, 0.0])
    np.testing.assert_allclose(planner(p + turn).states - turn, PENDULUM.unflatten(whole).states, atol=1e-5)
    assert len(planner.check(p[:0])) == 0


def test_blocks_cover_all_instances_and_hold_at_least_one():
    assert blocks(2100, 2) == [slice(0, 500), slice(500, 1000), slice(1000, 1500), slice(1500, 2000), slice(2000, 2500)]
    assert blocks(2, 5000) == [slice(0, 1), slice(1, 2)]
    assert blocks(0, 2) == [slice(0, 500)]


def test_a_plant_that_differs_is_planned_for():
    """Half the torque: a plan for the nominal plant does not reach the goal, and its verdict says so."""
    planner, p = moe_policy.load(PENDULUM, "moe-custom"), np.array([[0.3, 0.0]])
    nominal = Checked(planner)(p)
    told = Checked(planner, constants={"torque_gain": 0.5}, repair=Repair(1, rounds=0), abstain=False)
    assert told.model.system.constants["torque_gain"] == 0.5
    verdict = told._judged(told_selected(told, p, nominal), {}, np.zeros(1)).verdicts[0]
    assert not verdict.verified
    assert "from the goal, whose radius is" in verdict.reason


def told_selected(planner, p, plan):
    from moe_policy.checking.selection import select

    return select(planner._forecast, p, [plan], 0, np.zeros((1, 1), dtype=np.int64))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"experts": 0}, ValueError, "experts: expected a whole number of at least 1, got 0"),
        ({"constants": {"weight": 1.0}}, ValueError, "has no constant"),
        ({"nearest": moe_policy.load(PENDULUM, "snn")}, ValueError, "nearest belongs to PendulumSwingup-v0"),
    ],
)
def test_impossible_arguments_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        Checked(straight, problem=DISC, **arguments)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"iterations": 0}, ValueError),
        ({"rounds": -1}, ValueError),
        ({"margin": -1}, ValueError),
        ({"margin": "x"}, TypeError),
    ],
)
def test_impossible_repairs_are_refused(arguments, error):
    with pytest.raises(error, match=next(iter(arguments))):
        Repair(**arguments)
