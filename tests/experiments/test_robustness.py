"""Perturbed plants: what the environment is told, that no perturbation is the plain rollout, and curves that go on."""

import dataclasses
import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import run
from moe_policy.experiments.figures import generalisation as figures
from moe_policy.experiments.robustness import (
    LevelRow,
    PlantRow,
    Robustness,
    at_all_levels,
    informed,
    plant_key,
    run_plant,
)
from moe_policy.reports.records import read
from moe_policy.score.method import Method
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance

ROOT = Path(__file__).resolve().parents[2]
STARTS = np.array([[0.5, 0.0], [3.0, 0.4], [5.0, -1.0], [6.0, 1.5]])


def of(problem, name):
    return next(perturbation for perturbation in benchmark_of(problem).perturbations if perturbation.name == name)


@pytest.fixture(scope="module")
def stabiliser():
    return [Method("stabiliser", moe_policy.Stabiliser(PENDULUM))]


# -- running -----------------------------------------------------------------------------------------------------------


def test_no_perturbation_is_the_plain_rollout(stabiliser):
    starts = ocp_envs.sample(PENDULUM, 3, 60)
    plain, _ = run(PENDULUM, stabiliser[0], starts, batches=())
    for perturbation in benchmark_of(PENDULUM).perturbations:
        (row,) = run_plant(PENDULUM, stabiliser, starts, perturbation.arguments(PENDULUM, 0.0), seed=5)
        assert row == PlantRow.of("stabiliser", plain.metrics)


def test_the_seed_decides_the_noise(stabiliser):
    starts = ocp_envs.sample(PENDULUM, 3, 60)
    rough = of(PENDULUM, "disturbance").arguments(PENDULUM, 2.0)
    (first,), (again,), (other,) = (run_plant(PENDULUM, stabiliser, starts, rough, seed=s) for s in (0, 0, 999))
    assert first == again
    assert first != other
    (calm,) = run_plant(PENDULUM, stabiliser, starts, {})
    assert first.success.count < calm.success.count


def test_a_weak_motor_cannot_swing_up(stabiliser):
    """At a tenth of the torque no pendulum gets up; the torque is what changes."""
    (weak,) = run_plant(PENDULUM, stabiliser, STARTS, of(PENDULUM, "torque").arguments(PENDULUM, -90.0))
    (nominal,) = run_plant(PENDULUM, stabiliser, STARTS, {})
    assert weak.reached.count < nominal.reached.count


def test_equal_plants_are_one():
    keys = [
        plant_key("who", p.arguments(PENDULUM, lv)) for p in benchmark_of(PENDULUM).perturbations for lv in p.levels
    ]
    distinct = sum(len(p.levels) - 1 for p in benchmark_of(PENDULUM).perturbations) + 1
    assert len(set(keys)) == distinct
    assert plant_key("another", {}) not in keys


def test_a_planner_that_knows_the_constants_repairs_its_plans_for_them(stabiliser):
    known = informed(Method("moe-custom", moe_policy.load(PENDULUM, "moe-custom")), {"constants": {"mass": 1.2}})
    assert known.name == "moe-custom, constants known"
    assert known.planner.constants == {"mass": 1.2}
    with pytest.raises(TypeError, match="stabiliser: expected a planner"):
        informed(stabiliser[0], {})


def test_methods_that_were_not_run_at_all_levels_are_left_out(stabiliser):
    delay = dataclasses.replace(of(PENDULUM, "delay"), levels=(0.0, 20.0))
    plants = [run_plant(PENDULUM, stabiliser, STARTS, delay.arguments(PENDULUM, level)) for level in delay.levels]
    more = dataclasses.replace(plants[0][0], name="constants known")
    rows = at_all_levels(delay, [(*plants[0], more), plants[1]])
    assert [(row.level, row.outcome) for row in rows] == [(0.0, plants[0][0]), (20.0, plants[1][0])]


# -- the figure --------------------------------------------------------------------------------------------------------


def a_record(problem, methods, starts, perturbation):
    levels = sorted({perturbation.levels[0], 0.0, perturbation.levels[-1]})
    perturbation = dataclasses.replace(perturbation, levels=tuple(levels))
    rows = [
        LevelRow(perturbation=perturbation.name, level=level, outcome=row)
        for level in perturbation.levels
        for row in run_plant(problem, methods, starts, perturbation.arguments(problem, level))
    ]
    return Robustness(
        env_id=problem.id,
        cases=len(starts),
        seed=0,
        dt=0.02,
        perturbations=(perturbation,),
        rows=tuple(rows),
        cpu_seconds=0.0,
        provenance=provenance(),
    )


def test_curves_and_tables_show_the_rows(stabiliser):
    from matplotlib.figure import Figure

    record = a_record(PENDULUM, stabiliser, STARTS, of(PENDULUM, "mass"))
    (mass,) = record.perturbations
    axes = Figure().subplots()
    figures.draw_panel(axes, record, mass, figures.SUCCESS)
    (line,) = axes.lines  # no dashed one: the stabiliser has no plan
    counts = [row.outcome.success.count for row in record.rows]
    np.testing.assert_array_equal(line.get_xdata(), mass.levels)
    np.testing.assert_allclose(line.get_ydata(), [25 * count for count in counts])
    head, _, row = record.tables().splitlines()
    assert head.split() == ["mass,", "%", "-30", "0", "30"]
    assert row.split() == ["stabiliser", *map(str, counts)]


def test_the_figure_of_the_obstacle_shows_violations(drawn):
    methods = [Method("stabiliser", moe_policy.Stabiliser(QUADCOPTER_OBSTACLE))]
    starts = reference.load(QUADCOPTER_OBSTACLE, "development").parameters[:2]
    delay = of(QUADCOPTER_OBSTACLE, "delay")
    record = a_record(QUADCOPTER_OBSTACLE, methods, starts, delay)
    assert all(row.outcome.violation_mean is not None for row in record.rows)
    axes = drawn(figures.robustness_figure, record).axes
    assert [axes[0].get_ylabel(), axes[3].get_ylabel()] == ["success, %", "mean violation, m"]
    np.testing.assert_array_equal(axes[3].lines[0].get_ydata(), [row.outcome.violation_mean for row in record.rows])


# -- the script --------------------------------------------------------------------------------------------------------


class OneThread(ThreadPoolExecutor):
    """In place of a pool of processes, which would not see what a test has changed."""

    def __init__(self, workers):
        super().__init__(1)


@pytest.fixture
def script(monkeypatch, stabiliser):
    """The script on two perturbations of two methods."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.delitem(sys.modules, "compare_robustness", raising=False)
    module = importlib.import_module("compare_robustness")
    perturbations = tuple(
        dataclasses.replace(of(PENDULUM, name), levels=levels)
        for name, levels in (("mass", (-30.0, 0.0, 30.0)), ("disturbance", (0.0, 2.0)))
    )
    nearest = moe_policy.load(PENDULUM.id, "nearest")
    monkeypatch.setattr(module, "WorkerPool", OneThread)
    changed = dataclasses.replace(benchmark_of(PENDULUM), perturbations=perturbations)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: changed)
    monkeypatch.setattr(module, "methods", lambda problem: stabiliser)
    monkeypatch.setattr(module, "solve_all", lambda problem, p, keep, workers=None: (nearest(p), np.ones(len(p))))
    return module


@pytest.fixture
def call(script, monkeypatch, tmp_path):
    def call(*more):
        folders = ("--data", tmp_path / "data", "--results", tmp_path / "results")
        monkeypatch.setattr(sys, "argv", ["compare_robustness", *map(str, (*folders, "--cases", 6, *more))])
        script.main()
        return read(tmp_path / "results" / f"robustness_{PENDULUM.id}.json", Robustness)

    return call


def test_an_interrupted_run_goes_on(script, call, monkeypatch, tmp_path):
    first = call()
    pairs = {("mass", -30.0), ("mass", 0.0), ("mass", 30.0), ("disturbance", 0.0), ("disturbance", 2.0)}
    assert {(row.perturbation, row.level, row.outcome.name) for row in first.rows} == {
        (*pair, name) for pair in pairs for name in ("optimal", "stabiliser")
    }
    assert all(row.outcome.success.total == first.cases == 6 for row in first.rows)
    assert (tmp_path / "results" / f"robustness_{PENDULUM.id}.png").stat().st_size > 1000
    kept = sorted((tmp_path / "data" / "robustness" / PENDULUM.id).iterdir())
    assert len(kept) == 4  # the nominal plant once
    kept[1].unlink()
    runs = []
    monkeypatch.setattr(script, "run_plant", lambda *a, **k: runs.append(a) or run_plant(*a, **k))
    again = call()
    assert len(runs) == 1
    assert again.rows == first.rows
    call("--seed", 1)
    assert len(runs) == 5


def test_what_is_kept_belongs_to_what_it_was_made_from(script, monkeypatch, tmp_path):
    flat = np.zeros((4, PENDULUM.flat_size))
    first = script.identity(PENDULUM, STARTS, flat, 0)
    assert script.identity(PENDULUM, STARTS.copy(), flat.copy(), 0) == first
    others = [
        script.identity(PENDULUM, STARTS + 1e-9, flat, 0),
        script.identity(PENDULUM, STARTS, flat + 1e-9, 0),
        script.identity(PENDULUM, STARTS, flat, 1),
    ]
    monkeypatch.setattr(script.store, "SHIPPED", tmp_path)
    (tmp_path / PENDULUM.id).mkdir()
    (tmp_path / PENDULUM.id / "stabiliser.json").write_text("another model of the same name")
    others.append(script.identity(PENDULUM, STARTS, flat, 0))
    assert len({first, *others}) == 5
