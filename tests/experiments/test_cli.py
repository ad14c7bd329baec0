"""The command line that all scripts share."""

import sys

import pytest

from moe_policy.experiments import cli
from moe_policy.store import SHIPPED
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE


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
