from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments import comparison
from moe_policy.experiments.comparison import COLUMNS, ComparisonRow, CostDifference
from moe_policy.learning import recipes
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.prediction_error import validation_error
from moe_policy.planners.stored import StoredPlans
from moe_policy.reports.records import ABSENT
from moe_policy.reports.tables import DASH, markdown_table
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import CostRatio
from moe_policy.score import method
from moe_policy.score.method import Method
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.solver import GuardedSolver
from tests.synthetic import fake_samples


class Zero:
    """A policy that never does anything."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 1), np.float32), None


@pytest.fixture(scope="module")
def solved():
    """Starts of the pendulum and their plans to θ = π."""
    p = sample(PENDULUM, 5, 10)
    windings = np.ones(len(p), np.int64)
    with GuardedSolver(PENDULUM) as solver:
        solutions = solver.solve(p, guesses(PENDULUM, p, windings, np.random.default_rng(0)), windings)
    assert solutions.solved.sum() >= 5
    return p[solutions.solved], solutions.trajectory[solutions.solved], solutions.cost[solutions.solved]


@pytest.fixture(scope="module")
def baseline(solved):
    p, plan, _ = solved
    return comparison.run(PENDULUM, Method("optimal", StoredPlans(p, plan)), p, batches=())


@pytest.fixture(scope="module")
def network():
    return recipes.make("snn", fake_samples(count=100), settings=TrainingSettings(epochs=3))


def test_everybody_becomes_a_policy(solved):
    p, plan, _ = solved
    planning = Method("plans", StoredPlans(p, plan))
    assert isinstance(planning.policy(PENDULUM, 0.02), TrackingPolicy)
    assert planning.planner is planning.actor
    acting = Method("acts", Zero())
    assert acting.planner is None
    assert isinstance(acting.policy(PENDULUM, 0.02), Stabilised)
    # The vehicle cannot hold its goal, and the stabiliser holds it from the start.
    assert acting.policy(VEHICLE, 0.02) is acting.actor
    stabiliser = Stabiliser(PENDULUM)
    assert Method("stabiliser", stabiliser).policy(PENDULUM, 0.02) is stabiliser


def test_solved_plans_succeed_at_their_own_cost(solved, baseline):
    p, _, cost = solved
    row, episodes = baseline
    assert row.metrics.success == Proportion(len(p), len(p))
    assert row.metrics.success_at_plan_end == Proportion(len(p), len(p))
    assert row.metrics.cost_ratio == CostRatio(1.0, len(p))
    # The cost counts up to the first entry into the ball, a little before the plan's end.
    assert (episodes.cost < cost * (1 + 1e-3)).all()
    assert (episodes.cost > 0.8 * cost).all()


def test_batches_do_not_change_the_row(solved, baseline, monkeypatch):
    p, plan, _ = solved
    monkeypatch.setattr(method, "BATCH", 2)
    row, episodes = comparison.run(PENDULUM, Method("optimal", StoredPlans(p, plan)), p, batches=())
    assert len(p) > 4
    assert row == baseline[0]
    np.testing.assert_array_equal(episodes.plan_end_error, baseline[1].plan_end_error)


def test_rows_of_networks_have_every_column(solved, baseline, network):
    p, plan, _ = solved
    method = Method("snn", network, "100 solutions", 1.5)
    row, _ = comparison.run(PENDULUM, method, p, optimal=plan, baseline=baseline[1], batches=(1, 3))
    shown = {column.title for column in COLUMNS if column.cell(row) != DASH}
    assert {"policy", "test error", "validation error", "plan, batch 1", "weights", "training"} <= shown
    assert ComparisonRow.from_json(json.loads(json.dumps(row.to_json()))) == row
    assert set(row.planning_seconds) == {"1", "3"}
    assert row.validation_error == validation_error(network, p, plan)
    assert row.test_error == network.report.test_error
    assert (row.parameters_total, row.training_seconds) == (network.parameters_total, 1.5)
    *_, line = markdown_table([row], COLUMNS).splitlines()
    assert f"{network.parameters_total:,}" in line
    assert "100 solutions" in line


def test_what_a_policy_without_a_plan_has_not_is_a_dash(solved, baseline):
    p, _, _ = solved
    row, episodes = comparison.run(PENDULUM, Method("zero", Zero()), p, baseline=baseline[1])
    assert (row.metrics.success_at_plan_end, row.metrics.plan_end_error_median) == (None, None)
    assert (row.parameters_total, row.parameters_active, row.data) == (None, None, None)
    assert {row.planning_seconds, row.test_error, row.validation_error} == {ABSENT}
    lines = markdown_table([replace(baseline[0], parameters_total=1, parameters_active=1, data="-"), row], COLUMNS)
    head, *_, cells = [line.strip("| ").split(" | ") for line in lines.splitlines()]
    texts = dict(zip(head, cells))
    assert texts["policy"] == "zero"
    absent = ("success at the plan's end (95 %)", "error at the plan's end", "learnt from", "weights", "… active")
    assert {texts[title] for title in absent} == {DASH}
    assert not {"test error", "mean violation on the whole path, m (95 %)"} & set(head)  # nobody has one
    assert np.isnan(episodes.plan_end_error).all()


def test_costs_are_compared_with_the_reference():
    found = CostDifference.of(np.array([1.0, 2.02, np.inf, 3.0]), np.array([1.0, 2.0, 1.0, 3.001]))
    assert found == CostDifference(within=2, largest=pytest.approx(0.01))
    assert found.to_json() == {"within_0.1_percent": 2, "largest": pytest.approx(0.01)}
    assert CostDifference.of(np.array([np.inf]), np.ones(1)) == CostDifference(within=0, largest=0.0)


def test_environments_run_on_beyond_the_goal():
    envs = environments(PENDULUM, 2, 0.05)
    envs.reset(options={"parameters": np.tile([[np.pi, 0.0]], (2, 1))})
    _, _, terminated, truncated, infos = envs.step(np.zeros((2, 1), np.float32))
    assert infos["is_success"].all()
    assert not (terminated | truncated).any()
    assert envs.unwrapped.dt == 0.05
    envs.close()
