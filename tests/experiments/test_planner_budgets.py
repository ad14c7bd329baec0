"""What planners' data and training took."""

import dataclasses
import json

import pytest

from moe_policy.experiments.planner_budgets import GenerationEffort, PlannerBudget, Trained, planner_rows
from moe_policy.experiments.records import ABSENT
from ocp_envs.problems.pendulum import PENDULUM

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
    def keep(kind, content):
        (tmp_path / f"{kind}_{PENDULUM.id}.json").write_text(json.dumps(content))

    assert GenerationEffort.read(tmp_path, PENDULUM) is None
    counts = GenerationEffort(problems=9, solves=20, iterations=100, rest={"size": 9})
    keep("data", {"splits": {"training": counts.to_json(), "development": {}}})
    assert GenerationEffort.read(tmp_path, PENDULUM) == counts
    assert counts.seconds is ABSENT
    assert PlannerBudget.of(PENDULUM, counts, 9, [1.0]).seconds is None
    keep("generation", {"development": EFFORT.to_json()})
    assert GenerationEffort.read(tmp_path, PENDULUM) == counts
    keep("generation", {"training": EFFORT.to_json()})
    assert GenerationEffort.read(tmp_path, PENDULUM) == EFFORT


def trained(name, samples, success, cases=None):
    seconds = (1.0,) * len(success)
    return Trained(name=name, samples=samples, success=success, violation=None, cases=cases, training_seconds=seconds)


def test_planners_are_listed_by_the_size_of_their_data():
    small = [trained("snn", 100, (20, 30)), trained("snn", 1000, (40, 45))]
    whole = [trained("snn", 1000, (40, 45)), trained("moe-custom", 1000, (50,), cases=50), trained("x", 9, (1,))]
    rows = planner_rows(PENDULUM, [*small, *whole], EFFORT, ("moe-custom", "snn"), 50)
    assert [(row.name, row.samples) for row in rows] == [("moe-custom", 1000), ("snn", 100), ("snn", 1000)]
    assert [row.validation_success.maximum for row in rows] == [1.0, 0.6, 0.9]
    assert rows[1].budget.solves == 400
    assert all(row.budget is None for row in planner_rows(PENDULUM, whole, None, ("snn",), 50))
