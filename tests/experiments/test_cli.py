"""The command line that all scripts share."""

import argparse
import sys

import gymnasium
import pytest

from moe_policy.experiments import cli
from moe_policy.store import SHIPPED
from ocp_envs import problems
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support import pool


@pytest.fixture
def parse(monkeypatch):
    """The arguments of a script called with some words and made with some options."""

    def call(*words, **options):
        monkeypatch.setattr(sys, "argv", ["script", *map(str, words)])
        return cli.parser("What it does.", **options).parse()

    return call


def test_the_problem_is_resolved(parse):
    assert parse().problem is PENDULUM
    assert parse("--env", VEHICLE.id).problem is VEHICLE
    assert "problem" not in parse(env=None)


def test_an_unknown_problem_ends_in_one_line_that_names_the_nearest(parse, capsys):
    with pytest.raises(SystemExit) as end:
        parse("--env", "GroundVehicel-v0")
    assert end.value.code == 2
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert "did you mean 'GroundVehicle-v0'?" in shown


@pytest.mark.parametrize("words", [("--workers", 0), ("--cases", -3), ("--cases", "few")])
def test_counts_are_whole_and_positive(words, parse, capsys):
    with pytest.raises(SystemExit):
        parse(*words, workers=True, cases="validation instances")
    assert "expected a whole number of 1 or more" in capsys.readouterr().err


def test_a_run_does_not_write_into_committed_folders(parse):
    arguments = parse(models=True)
    assert (arguments.results, arguments.models) == (cli.RUNS, cli.RUNS / "models")
    ignored = (cli.ROOT / ".gitignore").read_text().splitlines()
    assert "/runs/" in ignored


def test_shipping_writes_records_and_models_unless_folders_are_named(parse, tmp_path):
    shipped = parse("--ship", models=True)
    assert (shipped.results, shipped.models) == (cli.RECORDS, SHIPPED)
    named = parse("--ship", "--results", tmp_path, "--models", tmp_path / "models", models=True)
    assert (named.results, named.models) == (tmp_path, tmp_path / "models")


def test_options_exist_only_where_a_script_has_them(parse):
    assert set(vars(parse(env=None, results=False))) == set()
    everything = parse(data=True, models=True, workers=True, seed=3, cases="instances")
    assert parse(cases="instances", default_cases=200).cases == 200
    assert vars(everything).keys() == {"problem", "data", "results", "ship", "models", "workers", "seed", "cases"}
    assert (everything.data, everything.workers, everything.seed, everything.cases) == (cli.DATA, None, 3, None)


@pytest.mark.parametrize("words", [("--seed", -1), ("--seed", "x"), ("--seed", 1.5)])
def test_seeds_are_whole_numbers(words, parse, capsys):
    with pytest.raises(SystemExit):
        parse(*words, seed=0)
    assert "expected a whole number of 0 or more" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["-1", "nan", "inf", "much"])
def test_amounts_are_finite_and_not_negative(text):
    with pytest.raises(argparse.ArgumentTypeError, match="expected a number of 0 or more"):
        cli.amount(text)


def test_amounts_are_numbers():
    assert cli.amount("1e-3") == 1e-3


def test_more_cases_than_there_are_is_an_error():
    with pytest.raises(cli.UsageError, match="--cases: got 5,000, there are 1,000 validation instances"):
        cli.at_most(5000, 1000, "validation instances")
    cli.at_most(1000, 1000, "validation instances")
    cli.at_most(None, 1000, "validation instances")


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(parse, capsys, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit):
        parse("--results", tmp_path / "file" / "results")
    assert f"argument --results: {tmp_path / 'file'} is not a folder" in capsys.readouterr().err


def test_a_folder_of_somebody_else_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(cli.os, "access", lambda path, mode: False)
    assert cli.fault_of(tmp_path / "new") == f"{tmp_path} is not writable"


def test_a_missing_package_is_told_with_its_cure(monkeypatch):
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    with pytest.raises(SystemExit, match=r'sb3_contrib is missing; install it with: .*"\.\[tqc\]"'):
        cli.need("sb3_contrib")


def test_a_missing_database_is_told_with_the_command_that_makes_it(parse, tmp_path):
    arguments = parse("--data", tmp_path, data=True)
    command = f"python scripts/generate_data.py --env {PENDULUM.id} --splits training --data {tmp_path}"
    with pytest.raises(SystemExit, match=f"there is no database .*training.zarr; make it with: {command}"):
        cli.database(arguments, "training")


OWN = """
import dataclasses, ocp_envs
ocp_envs.register(dataclasses.replace(ocp_envs.load("PendulumSwingup-v0"), id="OwnPendulum-v0"))
OTHER = dataclasses.replace(ocp_envs.load("PendulumSwingup-v0"), id="OtherPendulum-v0")
"""


@pytest.fixture
def own(monkeypatch, tmp_path):
    """A module in the working directory that registers a problem."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(problems, "_catalogue", dict(problems._catalogue))
    monkeypatch.setattr(pool, "_IMPORTED", [])
    (tmp_path / "own_problem.py").write_text(OWN)
    yield "own_problem"
    sys.modules.pop("own_problem", None)
    gymnasium.registry.pop("OwnPendulum-v0", None)
    gymnasium.registry.pop("OtherPendulum-v0", None)


def test_a_problem_of_the_user_comes_from_the_module_that_registers_it(own, parse):
    assert parse("--env", f"{own}:OwnPendulum-v0").problem.id == "OwnPendulum-v0"


def test_a_problem_of_the_user_may_be_a_variable_that_is_registered_then(own, parse, tmp_path):
    arguments = parse("--env", f"{own}:OTHER", "--data", tmp_path, data=True)
    assert arguments.problem is sys.modules[own].OTHER
    assert problems.load("OtherPendulum-v0") is arguments.problem
    with pytest.raises(SystemExit, match=rf"generate_data.py --env {own}:OTHER --splits training"):
        cli.database(arguments, "training")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("{}:OwnPendulm-v0", "did you mean 'OwnPendulum-v0'?"),
        ("{}:OTHR", "did you mean 'OTHER'?"),
        ("nothing:X-v0", "No module named"),
    ],
)
def test_a_module_or_problem_that_is_not_there_is_one_line(name, words, own, parse, capsys):
    with pytest.raises(SystemExit):
        parse("--env", name.format(own))
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1
