from __future__ import annotations

import numpy as np
import pytest

import moe_policy
from moe_policy import store
from moe_policy.checking.shipped import SHIPPED
from moe_policy.control.stabiliser import Stabiliser
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.solver import SolverPlanner
from moe_policy.protocols import Policy
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.store import UnknownModelError
from ocp_envs.problems import UnknownProblemError
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from tests.learners import random_actor
from tests.small_problems import DOUBLE_INTEGRATOR


def test_shipped_models_are_found_by_name(planners, tmp_path, monkeypatch):
    mixture = planners["mixture"]
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    mixture.save(tmp_path / PENDULUM.id / "moe-custom")
    assert moe_policy.available(PENDULUM.id) == ["moe-custom", "optimal", "stabiliser"]  # no mixture to be checked
    assert moe_policy.load(PENDULUM.id, "moe-custom").parameters_total == mixture.parameters_total
    with pytest.raises(UnknownModelError, match="did you mean 'moe-custom'"):
        moe_policy.load(PENDULUM.id, "moe-costum")
    with pytest.raises(UnknownProblemError, match="did you mean"):
        moe_policy.available("PendulumSwingup-v1")


@pytest.mark.parametrize("name", ["snn", "../../secret"])
def test_what_is_not_shipped_is_unknown(name, tmp_path, monkeypatch):
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    with pytest.raises(UnknownModelError, match="there are"):
        moe_policy.load(PENDULUM.id, name)


@pytest.fixture
def shipped(planners, tmp_path, monkeypatch):
    """A folder of shipped models with one of every kind."""
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    actor = LearnedPolicy(PENDULUM, random_actor((3, 8, 1), "tanh"), period=0.04, algorithm="sac", details={})
    for name, model in (("snn", planners["single"]), ("nearest", planners["nearest"]), ("sac", actor)):
        model.save(tmp_path / PENDULUM.id / name)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("snn", NetworkPlanner),
        ("nearest", NearestPlanner),
        ("optimal", SolverPlanner),
        ("sac", LearnedPolicy),
        ("stabiliser", Stabiliser),
    ],
)
def test_every_kind_of_model_is_loaded_as_its_class(shipped, name, kind):
    assert name in moe_policy.available(PENDULUM)
    assert type(moe_policy.load(PENDULUM, name)) is kind
    model = moe_policy.load(PENDULUM, name, kind=kind)
    assert isinstance(model, Policy) is (name in ("sac", "stabiliser"))
    other = NetworkPlanner if kind is SolverPlanner else SolverPlanner
    with pytest.raises(TypeError, match=f"{name} is a {kind.__name__}, expected a {other.__name__}"):
        moe_policy.load(PENDULUM, name, kind=other)


def test_every_kind_of_file_and_every_name_without_files_was_tried():
    assert set(store.READERS) == {"network", "nearest", "rl"}
    assert set(store.ALWAYS) == {"optimal", "stabiliser"}
    assert set(store.COMPOSED) == {"checked"}


def test_a_problem_and_its_id_mean_the_same(shipped):
    assert moe_policy.available(PENDULUM) == moe_policy.available(PENDULUM.id)
    first, second = (moe_policy.load(each, "snn", kind=NetworkPlanner) for each in (PENDULUM, PENDULUM.id))
    np.testing.assert_array_equal(first([1.0, 0.0]).flat(), second([1.0, 0.0]).flat())
    path = store.SHIPPED / PENDULUM.id / "snn"
    assert moe_policy.load_file(path, PENDULUM.id).problem is moe_policy.load_file(path).problem is PENDULUM


def test_a_problem_that_is_not_registered_has_what_needs_no_files():
    assert moe_policy.available(DOUBLE_INTEGRATOR) == ["optimal", "stabiliser"]
    assert moe_policy.load(DOUBLE_INTEGRATOR, "stabiliser").problem is DOUBLE_INTEGRATOR
    with pytest.raises(UnknownProblemError):
        moe_policy.available(DOUBLE_INTEGRATOR.id)


def test_the_optimal_planner_is_warm_started_from_the_shipped_samples(shipped):
    assert moe_policy.load(PENDULUM, "optimal", kind=SolverPlanner).random_guesses == 0
    assert len(store.shipped_nearest(PENDULUM).parameters) == 150
    assert store.shipped_nearest(VEHICLE) is None
    assert moe_policy.load(VEHICLE, "optimal", kind=SolverPlanner).random_guesses == 8


def test_a_goal_that_cannot_be_held_has_no_stabiliser():
    assert "stabiliser" not in moe_policy.available(VEHICLE)
    with pytest.raises(UnknownModelError):
        moe_policy.load(VEHICLE, "stabiliser")


def test_planners_and_policies_are_told_apart(shipped):
    assert isinstance(moe_policy.load_planner(PENDULUM, "snn"), NetworkPlanner)
    assert isinstance(moe_policy.load_policy(PENDULUM, "sac"), LearnedPolicy)
    with pytest.raises(TypeError, match="sac is a policy, expected a planner; use load_policy"):
        moe_policy.load_planner(PENDULUM, "sac")
    with pytest.raises(TypeError, match="optimal is a planner, expected a policy; use load_planner"):
        moe_policy.load_policy(PENDULUM, "optimal")


def test_the_checked_planner_wraps_a_shipped_mixture(shipped, planners):
    name = SHIPPED[PENDULUM.id].planner
    assert "checked" not in moe_policy.available(PENDULUM)
    planners["mixture"].save(store.SHIPPED / PENDULUM.id / name)
    checked = moe_policy.load(PENDULUM, "checked", kind=moe_policy.Checked)
    assert checked.planner.parameters_total == planners["mixture"].parameters_total
    assert len(checked.nearest.parameters) == 150
