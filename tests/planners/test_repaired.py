from functools import partial

import numpy as np
import pytest

import moe_policy
from moe_policy.planners.stored import StoredPlans
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers import improvement
from ocp_envs.solvers.check import verify
from ocp_envs.support.sharing import Loans
from tests.in_process import Solver
from tests.synthetic import fake_samples

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
P = np.array([[0.5, 0.0], [2.0, 1.0], [5.0, -1.0]])
TURN = np.array([2 * np.pi, 0.0])


@pytest.fixture(autouse=True)
def lent(monkeypatch):
    kept = Loans(partial(Solver, PENDULUM), 1)
    monkeypatch.setattr(improvement, "lent_solvers", lambda problem: kept)


@pytest.fixture(scope="module")
def mixture():
    return moe_policy.load(PENDULUM, "moe-custom")


def test_the_plan_of_a_mixture_is_repaired_within_its_family(mixture):
    repaired = moe_policy.Repaired(mixture)
    plans = repaired(P)
    assert repaired.problem is PENDULUM
    assert repaired.name == "moe-custom, repaired"
    assert verify(PENDULUM, P, plans).passed.all()
    np.testing.assert_allclose(plans.states[:, -1], mixture(P).states[:, -1], atol=0.1)


def test_plans_do_not_depend_on_the_batch_or_on_the_turn_of_angles(mixture):
    repaired = moe_policy.Repaired(mixture, 3)
    assert repaired.name == "moe-custom, repaired, 3 iterations"
    whole = repaired(P).flat()
    np.testing.assert_allclose(np.concatenate([repaired(row).flat() for row in P]), whole, atol=1e-7)
    turned = repaired(P + TURN)
    np.testing.assert_allclose(turned.states, PENDULUM.unflatten(whole).states + TURN, atol=1e-9)
    np.testing.assert_array_equal(turned.states[:, 0], P + TURN)


def test_a_planner_says_what_it_plans_for_or_is_told():
    samples = fake_samples()
    stored = StoredPlans(samples.parameters, samples.trajectory)
    with pytest.raises(ValueError, match=r"StoredPlans does not say what it plans for; give problem=…"):
        moe_policy.Repaired(stored)
    assert moe_policy.Repaired(stored, problem=PENDULUM).problem is PENDULUM
    with pytest.raises(ValueError, match="the planner belongs to PendulumSwingup-v0, not to QuadcopterObstacle-v0"):
        moe_policy.Repaired(moe_policy.NearestPlanner(samples), problem=QUADCOPTER_OBSTACLE)
    with pytest.raises(TypeError, match="planner: expected Planner, got str"):
        moe_policy.Repaired("moe-custom")


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"iterations": 0}, ValueError, "iterations: expected a whole number of at least 1, got 0"),
        ({"iterations": 2.5}, TypeError, "iterations: expected a whole number"),
        ({"margin": -0.1}, ValueError, "margin: expected at least 0, got -0.1"),
        ({"margin": "wide"}, TypeError, "margin: expected a finite number"),
    ],
)
def test_impossible_efforts_are_refused(mixture, arguments, error, message):
    with pytest.raises(error, match=message):
        moe_policy.Repaired(mixture, **arguments)


def test_plans_are_repaired_for_a_plant_with_other_constants(mixture, monkeypatch):
    monkeypatch.setattr(improvement, "lent_solvers", lambda problem: Loans(partial(Solver, problem), 1))
    heavy = PENDULUM.with_constants(mass=1.2 * PENDULUM.system.constants["mass"])
    repaired = moe_policy.Repaired(mixture, constants={"mass": heavy.system.constants["mass"]})
    assert repaired.problem is PENDULUM
    assert verify(heavy, P, repaired(P)).passed.all()
    assert not verify(heavy, P, mixture(P)).passed.any()


def test_constants_that_the_plant_does_not_have_are_refused(mixture):
    with pytest.raises(ValueError, match="weight"):
        moe_policy.Repaired(mixture, constants={"weight": 1.0})
    with pytest.raises(TypeError, match="constants"):
        moe_policy.Repaired(mixture, constants={"mass": "heavy"})


def test_constants_are_part_of_the_name(mixture):
    assert moe_policy.Repaired(mixture, constants={"mass": 1.2}).name == "moe-custom, repaired, mass 1.2"


def test_a_margin_is_part_of_the_name(mixture):
    assert moe_policy.Repaired(mixture, 1, margin=0.05).name == "moe-custom, repaired, 1 iteration, margin 0.05"
    assert moe_policy.Repaired(mixture, name="r").name == "r"
