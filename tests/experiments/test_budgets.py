"""What planners' data and training took, and the script and figure of budgets."""

import importlib
import json
import sys
from pathlib import Path

import pytest

from moe_policy.experiments.benchmark.parts import Benchmark, Learners, Planners
from moe_policy.experiments.budgets import PlannerBudget, generation_record, planner_rows
from moe_policy.experiments.curves import curve_of
from moe_policy.experiments.figures.budgets import budgets_figure
from moe_policy.rl.settings import PPOSettings, SACSettings
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference
from tests.experiments.test_curves import a_run, write

# -- planners ----------------------------------------------------------------------------------------------------------

GENERATION = {"problems": 1000, "solves": 4000, "iterations": 40_000, "seconds": 20.0, "workers": 2, "resumed_from": 0}


def test_a_planners_budget_is_its_share_of_the_data():
    whole = PlannerBudget.of(PENDULUM, GENERATION, 1000, [3.0, 9.0, 5.0])
    assert whole.states_of_solutions == 4000 * PENDULUM.knots
    assert whole.states_of_iterations == 40_000 * PENDULUM.knots
    assert whole.seconds == 20.0 + 5.0
    assert not whole.estimated
    half = PlannerBudget.of(PENDULUM, GENERATION, 500, [2.0])
    assert (half.solves, half.iterations, half.seconds, half.estimated) == (2000, 20_000, 12.0, True)
    with pytest.raises(ValueError, match="expected 1 to 1000 samples"):
        PlannerBudget.of(PENDULUM, GENERATION, 1001, [1.0])


def test_an_interrupted_generation_is_extrapolated_and_says_so():
    resumed = PlannerBudget.of(PENDULUM, GENERATION | {"resumed_from": 600}, 1000, [1.0])
    assert (resumed.generation_seconds, resumed.estimated) == (20.0 * 1000 / 400, True)
    nothing_new = PlannerBudget.of(PENDULUM, GENERATION | {"resumed_from": 1000}, 1000, [1.0])
    assert (nothing_new.generation_seconds, nothing_new.seconds) == (None, None)


def test_the_counts_of_the_data_report_stand_in_for_a_record_of_the_generation(tmp_path):
    assert generation_record(tmp_path, PENDULUM) is None
    counts = {"problems": 9, "solves": 20, "iterations": 100}
    write(tmp_path, f"data_{PENDULUM.id}", {"splits": {"training": counts, "development": {}}})
    assert PlannerBudget.of(PENDULUM, generation_record(tmp_path, PENDULUM), 9, [1.0]).seconds is None
    write(tmp_path, f"generation_{PENDULUM.id}", {"development": GENERATION})
    assert generation_record(tmp_path, PENDULUM) == counts
    write(tmp_path, f"generation_{PENDULUM.id}", {"training": GENERATION})
    assert generation_record(tmp_path, PENDULUM) == GENERATION


def trained(name, samples, success, **more):
    return {"name": name, "samples": samples, "success": success, "training_seconds": [1.0] * len(success), **more}


def test_planners_are_listed_by_the_size_of_their_data():
    record = {
        "sizes": [trained("snn", 100, [20, 30]), trained("snn", 1000, [40, 45])],
        "rows": [trained("snn", 1000, [40, 45]), trained("moe-custom", 1000, [50], cases=[50]), trained("x", 9, [1])],
    }
    rows = planner_rows(PENDULUM, record, GENERATION, ("moe-custom", "snn"), 50)
    assert [(row["name"], row["samples"]) for row in rows] == [("moe-custom", 1000), ("snn", 100), ("snn", 1000)]
    assert [row["validation_success"]["most"] for row in rows] == [1.0, 0.6, 0.9]
    assert rows[1]["budget"]["solves"] == 400
    assert all(row["budget"] is None for row in planner_rows(PENDULUM, record, None, ("snn",), 50))


# -- the figure --------------------------------------------------------------------------------------------------------


def a_record(**changes):
    development = {"success": 0.9, "cost_ratio": 0.95, "mean_return": -4.0, "violation": None}
    old = curve_of(a_run(PPOSettings(steps=300), [1, 20, 50]))
    new = old | {"cost_ratio": [None, 1.2, 1.1], "mean_return": [-300.0, -50.0, -4.5], "seed": 1}
    budget = PlannerBudget.of(PENDULUM, GENERATION, 500, [2.0, 3.0]).record()
    record = {
        "env_id": PENDULUM.id,
        "learners": {"ppo": {"seeds": [0, 1], "curves": [old, new], "chosen": None}},
        "planners": [
            {
                "name": "snn",
                "samples": 500,
                "budget": budget,
                "validation_success": Spread.of((0.8, 0.9)).to_json(),
                "validation_violation": None,
            }
        ],
        "shipped": [{"name": "snn", "samples": 500, "budget": budget, "development": development}],
        "levels": [{"name": "optimal", "development": development}],
    }
    return record | changes


def heights(path):
    imread = pytest.importorskip("matplotlib.image").imread

    return imread(path).shape[0]


def test_the_figure_shows_what_is_there(tmp_path):
    pytest.importorskip("matplotlib")
    whole = heights(budgets_figure(tmp_path / "whole.png", a_record()))
    lone = {"ppo": {"seeds": [0], "curves": [curve_of(a_run(PPOSettings(steps=300), [1, 2]))], "chosen": None}}
    bare = a_record(learners=lone, planners=[], shipped=[], levels=[])  # an old curve: success alone
    assert heights(budgets_figure(tmp_path / "bare.png", bare)) < whole / 2
    unknown = a_record()
    for row in (*unknown["planners"], *unknown["shipped"]):
        row["budget"] = None
    assert heights(budgets_figure(tmp_path / "unknown.png", unknown)) == whole


def test_the_script_from_end_to_end(monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    records = tmp_path / "records"
    records.mkdir()
    write(records, f"training_sac_{PENDULUM.id}", a_run(SACSettings(steps=200), [1, 2]))
    write(records, f"generation_{PENDULUM.id}", {"training": GENERATION | {"problems": 1281}})
    write(records, f"compare_training_{PENDULUM.id}", {"sizes": [], "rows": [trained("moe-custom", 1281, [990, 999])]})
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    module = importlib.import_module("compare_budgets")
    planners, learners = Planners(compared=("moe-custom",)), Learners(unattempted={"tqc": "no time"})
    benchmark = Benchmark(short="pendulum", planners=planners, learners=learners)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: benchmark)
    arguments = ["--cases", "5", "--records", str(records), "--results", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["compare_budgets", *arguments])
    module.main()
    record = json.loads((tmp_path / f"budgets_{PENDULUM.id}.json").read_text())
    assert [row["validation_success"]["median"] for row in record["planners"]] == pytest.approx([0.9945])
    assert record["not_attempted"] == {"tqc": "no time"}
    (shipped,), (optimal,) = record["shipped"], record["levels"]
    assert shipped["development"]["success"] == optimal["development"]["success"] == 1.0
    assert 0.9 < optimal["development"]["cost_ratio"] <= shipped["development"]["cost_ratio"] + 1e-3
    cost = reference.load(PENDULUM, "development").cost[:5].mean()
    assert optimal["development"]["mean_return"] == pytest.approx(-cost * optimal["development"]["cost_ratio"])
    assert record["learners"]["sac"]["curves"][0]["success"] == [0.02, 0.04]
    assert heights(tmp_path / f"budgets_{PENDULUM.id}.png") > 100
