"""What planners' data and training took."""

import dataclasses
import shutil
from pathlib import Path

import pytest

from moe_policy.experiments.planner_budgets import GenerationEffort, PlannerBudget, planner_rows
from moe_policy.experiments.seeds import Model, Training, TrainingRow
from moe_policy.reports.records import ABSENT
from ocp_envs.problems.pendulum import PENDULUM

RESULTS = Path(__file__).resolve().parents[2] / "results"
EFFORT = GenerationEffort(
    problems=1000, solves=4000, iterations=40_000, seconds=20.0, workers=2, resumed_from=0, rest={}
)


def test_a_planners_budget_is_its_fraction_of_the_data():
    whole = PlannerBudget.of(PENDULUM, EFFORT, 1000, [3.0, 9.0, 5.0])
    assert whole.states_of_solutions == 4000 * PENDULUM.knots
    assert whole.states_of_iterations == 40_000 * PENDULUM.knots
    assert whole.seconds == 20.0 + 5.0
    assert not whole.estimated
    half = PlannerBudget.of(PENDULUM, EFFORT, 500, [2.0])
    assert (half.solves, half.iterations, half.seconds, half.estimated) == (2000, 20_000, 12.0, True)
    with pytest.raises(ValueError, match="expected 1 to 1000 samples"):
        PlannerBudget.of(PENDULUM, EFFORT, 1001, [1.0])


def test_an_interrupted_generation_is_extrapolated_and_says_so():
    resumed = PlannerBudget.of(PENDULUM, dataclasses.replace(EFFORT, resumed_from=600), 1000, [1.0])
    assert (resumed.generation_seconds, resumed.estimated) == (20.0 * 1000 / 400, True)
    nothing_new = PlannerBudget.of(PENDULUM, dataclasses.replace(EFFORT, resumed_from=1000), 1000, [1.0])
    assert (nothing_new.generation_seconds, nothing_new.seconds) == (None, None)


def test_the_counts_of_the_data_report_stand_in_for_a_record_of_the_generation(tmp_path):
    assert GenerationEffort.read(tmp_path, PENDULUM) is None
    shutil.copy(RESULTS / f"data_{PENDULUM.id}.json", tmp_path)
    counts = GenerationEffort.read(tmp_path, PENDULUM)
    assert counts.seconds is ABSENT
    assert PlannerBudget.of(PENDULUM, counts, counts.problems, [1.0]).seconds is None
    shutil.copy(RESULTS / f"generation_{PENDULUM.id}.json", tmp_path)
    effort = GenerationEffort.read(tmp_path, PENDULUM)
    assert effort.seconds > 0
    assert "digest" in effort.rest


def trained(name, samples, success):
    models = [
        Model(
            training=Training(seed=seed, samples=samples, test_error=0.0, training_seconds=1.0),
            success=count,
            success_at_plan_end=count,
            reached=count,
            violation=None,
            knot_violation=None,
            validation_error=0.0,
        )
        for seed, count in enumerate(success)
    ]
    return TrainingRow.of(name, models)


def test_planners_are_listed_by_the_size_of_their_data():
    small = [trained("snn", 100, (20, 30)), trained("snn", 1000, (40, 45))]
    whole = [trained("snn", 1000, (40, 45)), trained("moe-custom", 1000, (50,)), trained("x", 9, (1,))]
    rows = planner_rows(PENDULUM, [*small, *whole], EFFORT, ("moe-custom", "snn"), 50)
    assert [(row.name, row.samples) for row in rows] == [("moe-custom", 1000), ("snn", 100), ("snn", 1000)]
    assert [row.validation_success.maximum for row in rows] == [1.0, 0.6, 0.9]
    assert rows[1].budget.solves == 400
    assert all(row.budget is None for row in planner_rows(PENDULUM, whole, None, ("snn",), 50))
