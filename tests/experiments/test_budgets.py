"""The record of budgets, its table, its figure and its script."""

import dataclasses
import importlib
import shutil
import sys
from pathlib import Path

import pytest

from moe_policy.experiments.benchmark.parts import Benchmark, Learners, Planners
from moe_policy.experiments.budgets import BUDGET_COLUMNS, Budgets, Level, ShippedPlanner
from moe_policy.experiments.figures.budgets import budgets_figure
from moe_policy.experiments.learner_budgets import ChosenActor, Curve, DevelopmentMetrics, LearnerBudget
from moe_policy.experiments.learners import CaseSet
from moe_policy.experiments.planner_budgets import PlannerBudget, PlannerRow
from moe_policy.reports.records import read
from moe_policy.reports.tables import markdown_table
from moe_policy.rl.settings import PPOSettings, SACSettings
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance
from tests.experiments.learner_records import keep, training
from tests.experiments.test_planner_budgets import EFFORT, RESULTS

OLD = training(PPOSettings(steps=300), [1, 20, 50])
BUDGET = PlannerBudget.of(PENDULUM, EFFORT, 500, [2.0, 3.0])
DEVELOPMENT = DevelopmentMetrics(success=0.9, cost_ratio=0.95, mean_return=-4.0, violation=None)


def a_record(**changes):
    new = dataclasses.replace(Curve.of(OLD.run), cost_ratio=(None, 1.2, 1.1), mean_return=(-300.0, -50.0, -4.5), seed=1)
    learner = dataclasses.replace(LearnerBudget.of([OLD]), seeds=(0, 1), curves=(Curve.of(OLD.run), new))
    planner = PlannerRow(
        name="snn",
        samples=500,
        budget=BUDGET,
        validation_success=Spread.of((0.8, 0.9)),
        validation_violation=None,
    )
    record = Budgets(
        env_id=PENDULUM.id,
        given={},
        not_attempted={},
        development=CaseSet(name="development", count=50),
        validation=CaseSet(name="validation", count=1000),
        learners={"ppo": learner},
        generation=EFFORT,
        planners=(planner,),
        shipped=(ShippedPlanner(name="snn", samples=500, budget=BUDGET, development=DEVELOPMENT),),
        levels=(Level(name="optimal", cases=50, development=DEVELOPMENT),),
        provenance=provenance(),
    )
    return dataclasses.replace(record, **changes)


def test_the_seeds_of_a_learner_are_one_budget():
    other = training(PPOSettings(steps=300, seed=1), [2, 40], steps=250)
    budget = LearnerBudget.of([OLD, other])
    assert (budget.seeds, budget.steps, budget.trials_before) == ((0, 1), (300, 250), 0)
    assert "seed" not in budget.settings
    assert budget.simulated_seconds == (30.0, 25.0)
    assert budget.validation_success.values == (1.0, 0.8)


def test_the_table_has_learners_then_planners_then_levels():
    chosen = ChosenActor(steps=200, seconds=4.0, development=DEVELOPMENT)
    learners = {"ppo": dataclasses.replace(a_record().learners["ppo"], chosen=chosen)}
    rows = a_record(learners=learners).with_rows().rows
    names = ["ppo, seed 0", "ppo, seed 1", "ppo, the shipped actor", "snn", "optimal"]
    assert [row.name for row in rows] == names
    assert [row.development.success for row in rows] == [1.0, 1.0, 0.9, 0.9, 0.9]
    assert rows[3].states == BUDGET.states_of_iterations
    text = markdown_table(rows, BUDGET_COLUMNS).splitlines()
    assert text[0] == "| method | solves | simulated states | wall time | success | cost / optimal | mean return |"
    assert text[-1] == "| optimal | – | – | – | 90.0% | 0.950 | -4.00 |"


# -- the figure --------------------------------------------------------------------------------------------------------


def heights(path):
    imread = pytest.importorskip("matplotlib.image").imread

    return imread(path).shape[0]


def test_the_figure_shows_what_is_there(tmp_path):
    pytest.importorskip("matplotlib")
    whole = heights(budgets_figure(tmp_path / "whole.png", a_record()))
    lone = {"ppo": LearnerBudget.of([OLD])}
    bare = a_record(learners=lone, planners=(), shipped=(), levels=())  # an old curve: success alone
    assert heights(budgets_figure(tmp_path / "bare.png", bare)) < whole / 2
    planners, shipped = (
        tuple(dataclasses.replace(row, budget=None) for row in rows)
        for rows in (a_record().planners, a_record().shipped)
    )
    assert heights(budgets_figure(tmp_path / "unknown.png", a_record(planners=planners, shipped=shipped))) == whole


@pytest.mark.parametrize("path", sorted(RESULTS.glob("budgets_*.json")), ids=lambda path: path.stem)
def test_costs_in_the_table_are_relative_to_the_tracked_optimum(path):
    record = read(path, Budgets)
    table, optimum = record.relative(), record.levels[0].development.cost_ratio
    assert table.levels[0].development.cost_ratio == 1.0
    for relative, absolute in zip(table.rows, record.rows, strict=True):
        found, known = relative.development.cost_ratio, absolute.development.cost_ratio
        assert (found is None and known is None) or found == pytest.approx(known / optimum)


# -- the script --------------------------------------------------------------------------------------------------------


def test_the_script_from_end_to_end(monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    records = tmp_path / "records"
    records.mkdir()
    keep(records, training(SACSettings(steps=200), [1, 2]))
    for kind in ("generation", "compare_training"):
        shutil.copy(RESULTS / f"{kind}_{PENDULUM.id}.json", records)
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    module = importlib.import_module("compare_budgets")
    planners, learners = Planners(compared=("moe-custom",)), Learners(unattempted={"tqc": "no time"})
    benchmark = Benchmark(short="pendulum", planners=planners, learners=learners)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: benchmark)
    arguments = ["--cases", "5", "--records", str(records), "--results", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["compare_budgets", *arguments])
    module.main()
    record = read(tmp_path / f"budgets_{PENDULUM.id}.json", Budgets)
    assert {row.name for row in record.planners} == {"moe-custom"}
    assert record.planners[-1].validation_success.median > 0.99
    assert record.not_attempted == {"tqc": "no time"}
    (shipped,), (optimal,) = record.shipped, record.levels
    assert shipped.development.success == optimal.development.success == 1.0
    assert 0.9 < optimal.development.cost_ratio <= shipped.development.cost_ratio + 1e-3
    cost = reference.load(PENDULUM, "development").cost[:5].mean()
    assert optimal.development.mean_return == pytest.approx(-cost * optimal.development.cost_ratio)
    assert record.learners["sac"].curves[0].success == (0.02, 0.04)
    assert heights(tmp_path / f"budgets_{PENDULUM.id}.png") > 100
