"""Every script, from end to end at its smallest, in folders of the test's own."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib
import io
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.experiments import cli, cluster_models, comparison, trainings
from moe_policy.experiments.benchmark.parts import Quick
from moe_policy.learning.settings import TrainingSettings
from moe_policy.reports.tables import text_table
from moe_policy.rl.settings import SACSettings
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference
from ocp_envs.sets.splits import InstanceSet, ProblemSets
from ocp_envs.support import progress
from ocp_envs.support.compiler import find_compiler

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(path.stem for path in (ROOT / "scripts").glob("*.py"))
QUICK = TrainingSettings(epochs=3)
FEW = GenerationSettings(first=20, chunk=20, starts=2)
TINY = {
    "training": InstanceSet(grid=(10, 4), settings=FEW),
    "development": InstanceSet(size=4, seed=101, settings=FEW),
    "validation": InstanceSet(size=12, seed=202, settings=FEW),
}
COMPARED = ("nearest", "snn", "moe-custom", "moe-kmeans-4", "sac")
shipped = pytest.mark.skipif(
    not set(COMPARED) <= set(moe_policy.available(PENDULUM.id)), reason=f"needs the shipped models {COMPARED}"
)


@pytest.fixture
def script(monkeypatch, tmp_path):
    """Imports a script by name, its folder being that of the tests' results; spawned processes find it, too."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ocp_envs.problems, "_catalogue", dict(ocp_envs.problems._catalogue))  # the example adds to it

    def load(name):
        monkeypatch.delitem(sys.modules, name, raising=False)
        return importlib.import_module(name)

    return load


@pytest.fixture
def run(monkeypatch):
    """Runs a script's main with arguments; its exit status."""

    def call(module, *arguments):
        monkeypatch.setattr(sys, "argv", [module.__name__, *map(str, arguments)])
        return module.main()

    return call


def with_tiny_splits(monkeypatch, module):
    monkeypatch.setattr(module, "sets_of", lambda problem: ProblemSets(**TINY))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Databases of the tiny splits, as scripts/generate_data.py makes them."""
    folder = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.syspath_prepend(str(ROOT / "scripts"))
        module = importlib.import_module("generate_data")
        with_tiny_splits(monkeypatch, module)
        monkeypatch.setattr(reference, "save", functools.partial(reference.save, folder=folder / "reference"))
        monkeypatch.setattr(
            sys, "argv", ["generate_data", "--data", str(folder), "--workers", "1", "--ship", "--results", str(folder)]
        )
        module.main()
    return folder


def read(path):
    return json.loads(path.read_text())


# -- the command line --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_script_explains_itself(name, script, run, capsys):
    module = script(name)
    with pytest.raises(SystemExit) as end:
        run(module, "--help")
    assert end.value.code == 0
    shown = capsys.readouterr().out
    assert module.__doc__.splitlines()[0] in shown
    assert "--help" in shown


@pytest.mark.parametrize("name", sorted(set(SCRIPTS) - {"example_cartpole"}))
def test_every_script_ends_in_one_line_where_it_is_interrupted_or_fails(name):
    assert '__name__ == "__main__":\n    cli.run(main' in (ROOT / "scripts" / f"{name}.py").read_text()


NEEDING_DATA = [
    ("train_planners", "training"),
    ("choose_tracking", "development"),
    ("compare_training", "training"),
    ("choose_clusters", "training"),
    ("find_families", "training"),
    ("compare_borders", "training"),
    ("explain_failures", "training"),
    ("report_data", "training"),
]


@pytest.mark.parametrize(("name", "database"), NEEDING_DATA)
def test_a_script_without_its_data_names_the_command_that_makes_them(name, database, script, run, tmp_path):
    command = f"python scripts/generate_data.py --env {PENDULUM.id} --splits {database} --data {tmp_path}"
    with pytest.raises(SystemExit, match=f"make it with: {command}"):
        run(script(name), "--env", PENDULUM.id, "--data", tmp_path, "--results", tmp_path)


@pytest.mark.parametrize(
    "name", ["compare_rl_vs_moe", "compare_robustness", "compare_budgets", "compare_splits", "check_discretisation"]
)
def test_more_cases_than_there_are_end_before_any_work(name, script, run, tmp_path):
    with pytest.raises(SystemExit, match=r"--cases: got 100,000,000, there are 1,000 "):
        run(script(name), "--cases", 100_000_000, "--results", tmp_path)


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_script_explains_itself_on_a_console_without_greek_letters(name, script, monkeypatch):
    module, console = script(name), io.TextIOWrapper(io.BytesIO(), encoding="cp1252")
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    monkeypatch.setattr(sys, "stdout", console)
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    monkeypatch.setattr(progress, "_shown", None)
    with pytest.raises(SystemExit) as end:
        cli.run(module.main)
    assert end.value.code == 0
    console.flush()
    assert b"--help" in console.buffer.getvalue()


@pytest.mark.parametrize("name", sorted(set(SCRIPTS) - {"render_readme", "example_cartpole"}))
def test_options_of_all_scripts_have_the_same_words(name, script, run, capsys):
    with pytest.raises(SystemExit):
        run(script(name), "--help")
    shown = " ".join(capsys.readouterr().out.split())
    for option, words in {
        "--data FOLDER": "databases; data/ by default",
        "--results FOLDER": "where results go; runs/ by default",
        "--workers N": "processes; one per core by default",
        "--seed N": "random seed; default",
    }.items():
        assert f"{option} {words}" in shown or option not in shown
    assert "Folders that you name are relative to the working directory" in shown


def test_scripts_run_from_any_folder(tmp_path):
    command = [sys.executable, str(ROOT / "scripts" / "generate_data.py"), "--splits", "exam", "--data", str(tmp_path)]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode != 0
    assert "no split 'exam'" in result.stderr
    assert list(tmp_path.iterdir()) == []


# -- data and planners -------------------------------------------------------------------------------------------------


def test_generate_data_makes_and_ships_every_split(data):
    for name, split in TINY.items():
        database = ocp_envs.Database.open(data / PENDULUM.id / f"{name}.zarr", PENDULUM)
        np.testing.assert_array_equal(database.parameters, split.parameters(PENDULUM))
        assert database.totals()["solved"] == len(database)
        if name in reference.SHIPPED:
            written = reference.load(PENDULUM, name, data / "reference")
            np.testing.assert_array_equal(written.cost, database.samples().cost)
    record = read(data / f"generation_{PENDULUM.id}.json")
    assert set(record) == set(TINY)
    assert all(0 < row["memory"]["parent_gb"] < row["memory"]["bound_gb"] < 4 for row in record.values())


def test_train_planners(data, script, run, monkeypatch, tmp_path):
    module = script("train_planners")
    benchmark = module.benchmark_of(PENDULUM)
    training = dataclasses.replace(benchmark.training, settings=QUICK)
    planners = dataclasses.replace(benchmark.planners, stored=30)
    benchmark = dataclasses.replace(benchmark, training=training, planners=planners)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: benchmark)
    run(module, "--data", data, "--models", tmp_path, "--seed", 3, "--workers", 1)
    folder = tmp_path / PENDULUM.id
    names = {path.name.removesuffix(".json") for path in folder.glob("*.json")}
    assert names == {"nearest", *benchmark.planners.trained}
    assert len(moe_policy.load_file(folder / "nearest").parameters) == 30
    for name in names:
        planner = moe_policy.load_file(folder / name)
        assert planner.name == name
        assert planner([1.0, 0.5]).finite.all()
        assert name == "nearest" or (planner.details["samples"], planner.details["seed"]) == (40, 3)


# -- comparisons -------------------------------------------------------------------------------------------------------


@shipped
def test_compare_with_the_shipped_models(script, run, tmp_path, capsys):
    run(script("compare_rl_vs_moe"), "--cases", 20, "--results", tmp_path)
    names = ["compare_PendulumSwingup-v0.json", "compare_PendulumSwingup-v0.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    record = read(tmp_path / names[0])
    rows = {row["name"]: row for row in record["rows"]}
    assert set(rows) == {"optimal", *COMPARED, "ppo", "stabiliser"}
    assert all(row["success"]["total"] == record["cases"] == 20 for row in rows.values())
    assert rows["optimal"]["success"]["count"] == 20
    assert rows["moe-custom"]["success"]["count"] >= 19
    assert rows["snn"]["success_at_plan_end"]["count"] < rows["moe-custom"]["success_at_plan_end"]["count"]
    # The optimum is the cheapest; only the way into the goal ball may be a little shorter.
    assert all(row["cost_ratio"]["ratio"] > 0.99 for row in rows.values())
    assert record["reference_gap"]["within_0.1_percent"] >= 19
    typed = comparison.Comparison.from_json(record)
    assert text_table(typed.rows, comparison.COLUMNS) in capsys.readouterr().out


@pytest.mark.slow
def test_compare_makes_everything_anew(script, run, monkeypatch, tmp_path):
    module = script("compare_rl_vs_moe")
    with_tiny_splits(monkeypatch, module)
    short = SACSettings(steps=400, learning_starts=200, n_envs=4, hidden=(8, 8), evaluate_every=200)
    benchmark = module.benchmark_of(PENDULUM)
    training = dataclasses.replace(benchmark.training, settings=QUICK)
    learners = dataclasses.replace(benchmark.learners, short={"sac": short})
    benchmark = dataclasses.replace(benchmark, training=training, learners=learners)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: benchmark)
    run(module, "--train", "--data", tmp_path / "data", "--results", tmp_path / "results")
    record = read(tmp_path / "results" / "compare_trained_PendulumSwingup-v0.json")
    assert record["cases"] == 12
    rows = {row["name"]: row for row in record["rows"]}
    assert set(rows) == {"optimal", *COMPARED, "stabiliser"}
    assert rows["optimal"]["success"]["count"] == 12
    assert rows["snn"]["data"] == "40 solutions"
    made = {path.name for path in (tmp_path / "data" / "compare" / PENDULUM.id).iterdir()}
    assert made >= {"training.zarr", "development.zarr", "validation.zarr", "snn.safetensors", "sac.safetensors"}


class OneThread(ThreadPoolExecutor):
    """In place of a pool of processes, which would not see what a test has changed."""

    def __init__(self, workers):
        super().__init__(1)

    def submit(self, fn, /, *args, **kwargs):
        pickle.dumps((args, kwargs))  # a process could take them
        return super().submit(fn, *args, **kwargs)


@pytest.mark.slow
def test_compare_training_goes_on_and_fills_its_table(data, script, run, monkeypatch, tmp_path):
    module = script("compare_training")
    whole = module.benchmark_of(PENDULUM)
    training = dataclasses.replace(whole.training, settings=QUICK, sizes={20: 2, 40: 2})
    benchmark = dataclasses.replace(whole, training=training)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: benchmark)
    for name, value in (
        ("benchmark_of", lambda problem: benchmark),
        ("PAPER", dataclasses.replace(QUICK, patience=2)),
        ("WorkerPool", OneThread),
    ):
        monkeypatch.setattr(trainings, name, value)
    copy = tmp_path / "data" / PENDULUM.id
    copy.mkdir(parents=True)
    for name in ("training.zarr", "validation.zarr"):
        (copy / name).symlink_to(data / PENDULUM.id / name)
    arguments = ("--seeds", 1, "--data", tmp_path / "data", "--results", tmp_path / "results")
    run(module, *arguments)
    record = read(tmp_path / "results" / "compare_training_PendulumSwingup-v0.json")
    keys = {"success_spread", "paper_success", "validation_error_spread", "paper_validation_error", "test_error_spread"}
    papers = [row for row in record["rows"] if row["name"] in benchmark.published]
    assert len(papers) == len(benchmark.published) == 9
    assert all(keys <= set(row) for row in papers)
    total = max(row["samples"] for row in record["rows"])
    expected = {(name, size) for name in benchmark.training.sized for size in (20, 40, total)}
    assert {(row["name"], row["samples"]) for row in record["sizes"]} == expected
    assert len(record["ablation"]) == len(benchmark.training.depths)
    pictures = {path.name for path in (tmp_path / "results").glob("*.png")}
    assert pictures == {f"training_{PENDULUM.id}_{name}.png" for name in ("clusters", "sizes", "jump", "errors")}
    # The second run finds all models of the first.
    monkeypatch.setattr(trainings, "execute", None)
    run(module, *arguments)
    again = read(tmp_path / "results" / "compare_training_PendulumSwingup-v0.json")
    assert again["rows"] == record["rows"]


def test_kept_models_are_evaluated_again_without_training(data, monkeypatch, tmp_path):
    run = trainings.Run("snn", 0, 30, QUICK)
    folders = trainings.Folders(data / PENDULUM.id, tmp_path)
    first = trainings.execute(PENDULUM.id, run, "key", folders)
    monkeypatch.setattr(trainings, "train", None)
    again = trainings.execute(PENDULUM.id, run, "key", folders)
    assert again == first


def test_networks_over_seeds_share_instances_and_settings(data, monkeypatch, tmp_path):
    benchmark = trainings.benchmark_of(PENDULUM)
    training = dataclasses.replace(benchmark.training, settings=QUICK, over_seeds=(30, 3))
    few = dataclasses.replace(benchmark, training=training)
    monkeypatch.setattr(trainings, "benchmark_of", lambda problem: few)
    monkeypatch.setattr(trainings, "WorkerPool", OneThread)
    (tmp_path / PENDULUM.id).mkdir()
    (tmp_path / PENDULUM.id / "training.zarr").symlink_to(data / PENDULUM.id / "training.zarr")
    database = ocp_envs.Database.open(data / PENDULUM.id / "training.zarr")
    runs = {run: run.key(database.key) for run in trainings.over_seeds(database, 2)}
    assert {(run.samples, run.settings.epochs) for run in runs} == {(30, 3)}
    with pytest.raises(FileNotFoundError, match=r"has no snn of seed 0.*--over-seeds"):
        trainings.networks(PENDULUM, tmp_path, 2)
    folders = trainings.Folders(tmp_path / PENDULUM.id, tmp_path / "compare_training" / PENDULUM.id)
    trainings.train_all(PENDULUM, runs, folders)
    found = trainings.networks(PENDULUM, tmp_path, 2)
    assert [(run.name, run.seed) for run in found] == [(name, s) for name in few.planners.compared for s in (0, 1)]
    assert {planner.details["samples"] for planner in found.values()} == {30}


def test_choose_tracking(data, script, run, tmp_path):
    module = script("choose_tracking")
    fitted = moe_policy.fit_single(ocp_envs.Database.open(data / PENDULUM.id / "training.zarr"), settings=QUICK)
    fitted.save(tmp_path / "snn")
    arguments = ("--env", PENDULUM.id, "--planners", tmp_path / "snn", "--data", data, "--results", tmp_path)
    run(module, *arguments)
    rows = read(tmp_path / f"tracking_{PENDULUM.id}.json")["rows"]
    assert len(rows) == 2 * len(module.CONTROL) * len(module.TERMINAL) * len(module.ROOM)
    assert {row["name"] for row in rows} == {"optimal", "snn"}
    assert len({row["plan_end_error_median"] for row in rows if row["name"] == "snn"}) > 10


def test_choose_clusters_goes_on(data, script, run, monkeypatch, tmp_path):
    module = script("choose_clusters")
    whole = module.benchmark_of(PENDULUM)
    clusters = dataclasses.replace(whole.clusters, numbers=(2, 3), used=3, instances=40, settings=QUICK)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: dataclasses.replace(whole, clusters=clusters))
    monkeypatch.setattr(cluster_models, "WorkerPool", OneThread)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / PENDULUM.id).symlink_to(data / PENDULUM.id)
    arguments = ("--seeds", 2, "--data", tmp_path / "data", "--results", tmp_path)
    run(module, *arguments)
    record = read(tmp_path / f"clusters_{PENDULUM.id}.json")
    assert [(row["k"], [model["seed"] for model in row["models"]]) for row in record["rows"]] == [
        (2, [0, 1]),
        (3, [0, 1]),
    ]
    assert (record["used"], record["samples"], record["split"]) == (3, 40, "development")
    assert record["cases"] == len(ocp_envs.Database.open(data / PENDULUM.id / "development.zarr", PENDULUM))
    monkeypatch.setattr(cluster_models, "train", None)
    run(module, *arguments)
    assert read(tmp_path / f"clusters_{PENDULUM.id}.json")["rows"] == record["rows"]


def test_find_families_goes_on(data, script, run, tmp_path, capsys):
    module = script("find_families")
    (tmp_path / "data" / PENDULUM.id).mkdir(parents=True)
    (tmp_path / "data" / PENDULUM.id / "training.zarr").symlink_to(data / PENDULUM.id / "training.zarr")
    arguments = ("--data", tmp_path / "data", "--results", tmp_path, "--cases", 20, "--workers", 1)
    run(module, *arguments)
    record = read(tmp_path / f"families_{PENDULUM.id}.json")
    assert record["samples"] == sum(row["instances"] for row in record["rows"]) <= 20
    assert record["seconds"] > 0
    assert (tmp_path / f"families_{PENDULUM.id}.png").stat().st_size > 10_000
    run(module, *arguments)
    again = read(tmp_path / f"families_{PENDULUM.id}.json")
    assert again["seconds"] is None
    assert again["rows"] == record["rows"]
    with pytest.raises(SystemExit):
        run(module, *arguments, "--over", "theta", "speed")
    assert "has no parameters ['speed']; there are ['theta', 'omega']" in capsys.readouterr().err


def test_compare_borders_goes_on(data, script, run, monkeypatch, tmp_path):
    module = script("compare_borders")
    whole, cases = module.benchmark_of(PENDULUM), ocp_envs.sample(PENDULUM, seed=1, n=6)
    training = dataclasses.replace(whole.training, settings=QUICK)
    monkeypatch.setattr(module, "benchmark_of", lambda problem: dataclasses.replace(whole, training=training))
    monkeypatch.setattr(module, "at_the_discontinuity", lambda *_: cases[:2])
    (tmp_path / "data" / PENDULUM.id).mkdir(parents=True)
    (tmp_path / "data" / PENDULUM.id / "training.zarr").symlink_to(data / PENDULUM.id / "training.zarr")
    arguments = ("--data", tmp_path / "data", "--results", tmp_path, "--seeds", 2, "--workers", 1)
    run(module, *arguments)
    record = read(tmp_path / f"borders_{PENDULUM.id}.json")
    assert (record["cases"], record["margin"]) == ({"uniform": 1000, "boundary": 2}, 0.1)
    assert [row["name"] for row in record["rows"]] == list(module.VARIANTS)
    assert sum(record["families"]) == record["samples"]
    monkeypatch.setattr(module.Mixtures, "planners", None)
    run(module, *arguments)
    assert read(tmp_path / f"borders_{PENDULUM.id}.json")["rows"] == record["rows"]


@pytest.mark.parametrize("name", ["compare_borders", "choose_partition"])
def test_a_problem_for_which_an_experiment_is_not_declared_is_refused(name, data, script, run, tmp_path, capsys):
    with pytest.raises(SystemExit):
        run(script(name), "--env", "Quadcopter-v0", "--data", tmp_path, "--results", tmp_path)
    assert "Quadcopter-v0" in capsys.readouterr().err


def test_numbers_of_clusters_must_be_declared(script, run, capsys):
    with pytest.raises(SystemExit):
        run(script("choose_clusters"), "--env", "QuadcopterObstacle-v0")
    assert "no numbers of clusters are declared for QuadcopterObstacle-v0" in capsys.readouterr().err


def test_the_other_reading_of_the_cost_swaps_velocity_and_angles(script):
    module = script("check_sensitivity")
    state, control = np.arange(1.0, 13.0), np.ones(4)
    difference = module.swapped_rate(state, control, None, None) - module.cost_rate(state, control, None, None)
    assert difference == pytest.approx(0.9 * (np.sum(state[6:9] ** 2) - np.sum(state[3:6] ** 2)))
    assert module.SWAPPED.fingerprint != module.QUADCOPTER.fingerprint


def test_reproduce_names_its_tables_and_figures(script, run, capsys):
    module = script("reproduce")
    run(module, "--list")
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[1].rstrip(":") for line in listed] == [*module.TABLES, module.SKETCH, *module.figure_names()]
    with pytest.raises(SystemExit):
        run(module)


@pytest.mark.slow
def test_reproduce_quickly(script, run, monkeypatch, tmp_path):
    """A table and figures of the pendulum, from few problems and the shipped networks."""
    module = script("reproduce")
    few = dataclasses.replace(module.benchmark_of(PENDULUM), quick=Quick(training=60, validation=6))
    monkeypatch.setattr(module, "benchmark_of", lambda problem: few)
    folders = ("--data", tmp_path / "data", "--results", tmp_path / "results")
    run(module, "--quick", "--table", "training", "--figure", "mixture", "pendulum-clusters", *folders)
    quick = tmp_path / "results" / "quick"
    record = read(quick / "table_training.json")
    rows = {row["name"]: row for row in record["rows"]}
    assert set(rows) == set(module.benchmark_of(PENDULUM).shipped)
    assert rows["moe-custom"]["paper_success"] == 998
    assert all(len(row["success"]) == 1 and 0 <= row["success"][0] <= 6 for row in rows.values())
    assert "| moe-custom |" in (quick / "table_training.md").read_text()
    for name in ("mixture", "pendulum-clusters"):
        for suffix in (".png", ".pdf", ".json"):
            assert (quick / f"figure_{name}{suffix}").stat().st_size > 0
    told = read(quick / "figure_pendulum-clusters.json")
    assert (told["training_problems"], told["validation_problems"], told["quick"]) == (60, 6, True)


def test_the_summary_stands_beside_the_paper(script, run, tmp_path):
    """From the committed records; a figure of the paper and one of ours in the cells where they belong."""
    module = script("reproduce")
    for problem in module.PAPER:
        (tmp_path / f"compare_training_{problem.id}.json").write_bytes(
            (ROOT / "results" / f"compare_training_{problem.id}.json").read_bytes()
        )
    run(module, "--table", "summary", "--results", tmp_path)
    record = read(tmp_path / "table_summary.json")
    rows = {row["label"]: row for row in record["rows"]}
    assert len(record["columns"]) == 6
    assert rows["SNN rollout"]["GroundVehicle-v0 moe-custom"].endswith("of 10,000 (6729)")
    ours = next(
        row for row in read(ROOT / "results" / "compare_training_Quadcopter-v0.json")["rows"] if row["name"] == "snn"
    )
    success = f"{ours['success_spread']['median']:.0f} of 1,000 (1000)"
    assert rows["SNN rollout"]["Quadcopter-v0 moe-kmeans-4"] == success
    assert rows["cluster sizes"]["PendulumSwingup-v0 moe-custom"].endswith("(388–505)")
    assert rows["gate size"]["QuadcopterObstacle-v0 moe-kmeans-8"] == "(7, 200, 200, 8)"


# -- README ------------------------------------------------------------------------------------------------------------


def test_render_readme(script, run, monkeypatch, tmp_path):
    module = script("render_readme")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "PAGES", ("README.md",))
    path = tmp_path / "README.md"
    path.write_text("before\n<!-- table: compare_X -->\nold\n<!-- end -->\nafter\n")
    (tmp_path / "results").mkdir()
    shutil.copy(ROOT / "results" / "compare_PendulumSwingup-v0.json", tmp_path / "results" / "compare_X.json")
    assert run(module, "--check") == 1
    assert "old" in path.read_text()
    assert run(module) == 0
    text = path.read_text()
    assert text.startswith("before\n<!-- table: compare_X -->\n")
    assert text.endswith("<!-- end -->\nafter\n")
    assert "old" not in text
    assert "\n| moe-custom | 982 (97.2–98.9 %) | 1000 (99.6–100.0 %) |" in text
    assert run(module, "--check") == 0


# -- reinforcement learning --------------------------------------------------------------------------------------------

SHORT = ("steps=400", "learning_starts=200", "n_envs=4", "hidden=(8, 8)", "evaluate_every=200")


def test_train_rl_ships_a_policy_and_its_record(script, run, monkeypatch, tmp_path):
    pytest.importorskip("stable_baselines3")
    module = script("train_rl")
    few = reference.ReferenceSet(np.array([[0.5, 0.0], [3.0, 0.1]]), np.ones((2, 3)))
    monkeypatch.setattr(module.reference, "load", lambda problem, split: few)
    folders = [f"--{name}={tmp_path / name}" for name in ("models", "results", "data")]
    run(module, "--trial", "two layers", *folders, "--set", *SHORT)
    assert not (tmp_path / "models").exists()
    run(module, *folders, "--set", *SHORT)
    record = read(tmp_path / "results" / "training_sac_PendulumSwingup-v0.json")
    assert (record["steps"], record["development"]) == (400, {"set": "development", "count": 2})
    assert [trial["note"] for trial in record["search"]] == ["two layers"]
    policy = moe_policy.load_file(tmp_path / "models" / PENDULUM.id / "sac")
    assert policy.predict(np.zeros((3, 2), np.float32), episode_start=np.ones(3, bool))[0].shape == (3, 1)


def test_train_rl_refuses_unknown_settings(script, run):
    with pytest.raises(SystemExit, match="expected name=value with a name of"):
        run(script("train_rl"), "--set", "speed=3")


# -- benchmarks and data quality ---------------------------------------------------------------------------------------


def test_benchmark_env(script, run, monkeypatch, tmp_path):
    module = script("benchmark_env")
    for name, value in (("REPETITIONS", 1), ("NUM_ENVS", 8)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(module, "single_step", functools.partial(module.single_step, steps=50))
    run(module, "--results", tmp_path)
    record = read(tmp_path / "benchmark_env.json")
    assert set(record["steps_per_second"]) >= {problem.id for problem in ocp_envs.BENCHMARK}
    assert all(rate > 0 for rate in record["steps_per_second"].values())


@shipped
def test_benchmark_rollout(script, run, monkeypatch, tmp_path):
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: None, raising=False)
    arguments = ("--episodes", 5, "--batch", 2, "--single", 1, "--repeats", 1, "--results", tmp_path)
    run(script("benchmark_rollout"), *arguments)
    record = read(tmp_path / f"benchmark_rollout_{PENDULUM.id}.json")
    assert record["same_successes"]
    assert record["ratio"] > 0
    assert record["environments"] == 2
    assert 0 < record["peak_memory_gb"] < 100


@shipped
@pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
def test_benchmark_export(script, run, monkeypatch, tmp_path):
    module = script("benchmark_export")
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: None, raising=False)
    monkeypatch.setattr(module, "PAPER", (PENDULUM,))
    monkeypatch.setattr(module, "PLANNERS", ("moe-custom",))
    run(module, "--cases", 2, "--calls", 3, "--rounds", 1, "--results", tmp_path)
    (row,) = read(tmp_path / "benchmark_export.json")["rows"]
    assert row["control_difference"] < 1e-9
    assert row["plan_difference"] < 1e-4
    assert row["in_c"]["regulators"] > 0


def test_benchmark_training(script, run, monkeypatch, tmp_path):
    module = script("benchmark_training")
    monkeypatch.setattr(module.ocp_envs, "names", lambda: (PENDULUM.id,))
    monkeypatch.setattr(module, "WorkerPool", OneThread)
    run(module, "--samples", 100, "--epochs", 1, "--results", tmp_path)
    (row,) = read(tmp_path / "benchmark_training.json")["rows"]
    assert row["samples_per_second"] > 0
    assert sum(row["fraction"].values()) == pytest.approx(1.0)
    assert list(row["ratio"]) == ["two threads", "two processes"]


def test_benchmark_peers(script, run, monkeypatch, tmp_path):
    module = script("benchmark_peers")
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: None, raising=False)
    for name in ("PENDULUMS", "QUADROTORS"):
        monkeypatch.setattr(module, name, 4)
    run(module, "--crazyflow", "no/python", "--rounds", 1, "--seconds", 0.001, "--results", tmp_path)
    record = read(tmp_path / "benchmark_peers.json")
    assert [len(rows) for rows in record["groups"].values()] == [2, 2, 1]
    assert "no/python" in record["missing"]["crazyflow"]


@shipped
def test_benchmark_scaling(script, run, monkeypatch, tmp_path):
    module = script("benchmark_scaling")
    monkeypatch.setenv("OMP_NUM_THREADS", os.environ.get("OMP_NUM_THREADS", "1"))
    monkeypatch.setattr(module, "BATCHES", {"steps": (1, 4), "plans": (1, 2), "solves": (1,)})
    monkeypatch.setattr(module, "OF_WORKERS", {"steps": 4, "plans": 2, "solves": 1})
    monkeypatch.setattr(module.ocp_envs, "names", lambda: (PENDULUM.id,))
    threads = ThreadPoolExecutor(2)
    monkeypatch.setattr(
        module, "executors", lambda: contextlib.nullcontext({"1 process": (threads, 1), "2 processes": (threads, 2)})
    )
    run(module, "--seconds", 0.001, "--results", tmp_path)
    record = read(tmp_path / "benchmark_scaling.json")
    assert [row["quantity"] for row in record["batches"]] == ["steps", "plans", "solves"]
    assert all(rate > 0 for row in record["batches"] for rate in row["per_second"].values())
    assert all(list(row["ratio_to_one"]) == ["1 process", "2 processes"] for row in record["workers"])
    assert (tmp_path / "benchmark_scaling.png").stat().st_size > 10_000


@pytest.mark.slow
def test_benchmark_solver(script, run, monkeypatch, tmp_path):
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: None, raising=False)
    arguments = ("--cases", 4, "--stored", 8, "--rounds", 1, "--results", tmp_path)
    run(script("benchmark_solver"), *arguments)
    record = read(tmp_path / f"benchmark_solver_{PENDULUM.id}.json")
    for kind in ("cold", "warm"):
        for solver, ratio in (("ours", "ratio_to_the_better"), ("riccati", "riccati_ratio")):
            assert record[kind][solver]["verified"] > 0
            assert record[kind][ratio] > 0


@pytest.mark.slow
def test_check_data(data, script, run, tmp_path):
    copy = tmp_path / "data" / PENDULUM.id
    copy.mkdir(parents=True)
    for path in (data / PENDULUM.id).glob("*.zarr"):
        (copy / path.name).symlink_to(path)
    arguments = ("--cases", 3, "--guesses", 4, "--workers", 1, "--data", tmp_path / "data", "--results", tmp_path)
    run(script("check_data"), *arguments)
    record = read(tmp_path / f"data_quality_{PENDULUM.id}.json")
    assert set(record["ways"]) == {"solve", "generate", "warm starts"}
    assert all(way["unsolved"] == 0 for way in record["ways"].values())
    assert set(record["databases"]) == set(TINY)
    assert all(found["failing"] == 0 for found in record["databases"].values())


def test_make_animations(script, run, monkeypatch, tmp_path):
    image = pytest.importorskip("PIL.Image")
    module = script("make_animations")
    monkeypatch.setattr(module, "FRAMES", 4)
    run(module, "--results", tmp_path)
    assert image.open(tmp_path / f"{PENDULUM.id}.webp").n_frames == 4


def test_every_environment_has_an_animation():
    for problem in ocp_envs.problems.BENCHMARK:
        assert (ROOT / "docs" / "animations" / f"{problem.id}.webp").stat().st_size < 150_000
