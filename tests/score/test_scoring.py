"""Scores: anybody's planner or policy, on the fixed instances, as a record and in a table."""

from __future__ import annotations

import dataclasses
import json

import pytest

import moe_policy
import ocp_envs
from moe_policy.reports.records import read
from moe_policy.score import __main__ as command
from moe_policy.score import scoring
from moe_policy.score.scoring import Score, score_method
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER

OWN = """
import numpy as np
import moe_policy

class Still:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 1)), state

def policy(problem):
    return Still()

def planner(problem, seed):
    return moe_policy.load(problem, "moe-custom")

nothing = None
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working directory with a module of the user's own, and a folder for optima."""
    (tmp_path / "own_method.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    monkeypatch.setattr(scoring, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path


def nearest(problem):
    return moe_policy.load(problem, "nearest")


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    keep = tmp_path_factory.mktemp("optima")
    return score_method(PENDULUM, nearest, name="nearest", cases=6, keep=keep, workers=1)


def test_a_score_has_the_metrics_of_every_usual_split(found):
    assert found.cases == {"uniform": 6, "boundary": 6, "outside": 6}
    assert found.kind == "planner"
    (run,) = found.runs
    assert run.seed is None
    assert run.parameters_total > 1000
    envs = moe_policy.environments(PENDULUM, 6)
    p = ocp_envs.load_reference(PENDULUM, "validation").parameters[:6]
    policy = moe_policy.TrackingPolicy(PENDULUM, moe_policy.load(PENDULUM, "nearest"))
    again = moe_policy.evaluate(PENDULUM, moe_policy.rollout(envs, policy, p))
    assert run.splits["uniform"].success_at_plan_end == again.success_at_plan_end
    assert 0.99 < run.splits["uniform"].relative_cost < 1.2


def test_a_score_is_a_record(found):
    assert Score.from_json(json.loads(json.dumps(found.to_json()))) == found


def test_the_table_orders_methods_by_success_and_names_the_split_once(found):
    better = dataclasses.replace(found, method="better")
    run = found.runs[0]
    worst = dataclasses.replace(
        run.splits["uniform"], success_at_plan_end=dataclasses.replace(run.splits["uniform"].success, count=0)
    )
    worse = dataclasses.replace(
        found, method="worse", runs=(dataclasses.replace(run, splits=run.splits | {"uniform": worst}),)
    )
    lines = scoring.table([worse, better]).splitlines()
    assert lines[2].startswith("| uniform, of 6 | better |")
    assert lines[3].startswith("|  | worse |")


def test_several_seeds_have_one_line(found):
    several = dataclasses.replace(found, runs=(*found.runs, *found.runs))
    assert "nearest, 2 seeds" in several.table


def test_scores_of_several_problems_have_no_table(found):
    with pytest.raises(ValueError, match="scores of one problem"):
        scoring.table([found, dataclasses.replace(found, env_id="Other-v0")])
    with pytest.raises(ValueError, match="got those of none"):
        scoring.table([])


@pytest.mark.parametrize(
    ("problem", "arguments", "message"),
    [
        (QUADCOPTER, {"splits": ["boundary"]}, "has no 'boundary'; there are uniform, near, outside"),
        (PENDULUM, {"cases": 0}, "cases"),
        (PENDULUM, {"seeds": [1, 2]}, "no argument 'seed'"),
        (dataclasses.replace(PENDULUM, id="Mine-v0"), {}, "Mine-v0: no instances are shipped"),
    ],
)
def test_what_cannot_be_measured_is_refused(problem, arguments, message):
    with pytest.raises(ValueError, match=message):
        score_method(problem, nearest, name="nearest", **arguments)


def test_a_factory_has_to_return_something_that_plans_or_acts():
    with pytest.raises(TypeError, match=r"returned a list; expected a planner, .* or a policy"):
        score_method(PENDULUM, lambda problem: [], name="none", cases=1)


def test_the_command_measures_a_policy_of_the_users_own(folder, capsys):
    command.main(["own_method:policy", "--cases", "2", "--split", "uniform", "--workers", "1"])
    found = read(folder / f"score_policy_{PENDULUM.id}.json", Score)
    assert (found.kind, found.factory) == ("policy", "own_method:policy")
    assert found.runs[0].splits["uniform"].success_at_plan_end is None
    shown = capsys.readouterr().out
    assert "| uniform, of 2 | policy |" in shown
    command.main(["--table", f"score_policy_{PENDULUM.id}.json"])
    assert capsys.readouterr().out in shown


def test_the_command_gives_the_factory_its_seeds(folder):
    command.main(["own_method:planner", "--cases", "2", "--split", "uniform", "--seeds", "3", "4", "--name", "mine"])
    found = read(folder / f"score_mine_{PENDULUM.id}.json", Score)
    assert [run.seed for run in found.runs] == [3, 4]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected module:factory, the name of a shipped model, or --table"),
        (["own_method:nothing"], "has nothing called 'nothing' that can be called"),
        (["no_such_module:f"], "No module named 'no_such_module'"),
        (["moe-costum", "--cases", "1"], "did you mean 'moe-custom'"),
        (["snn", "--env", "Pendulum-v7"], "unknown problem 'Pendulum-v7'"),
        (["--table", "missing.json"], "missing.json"),
    ],
)
def test_errors_of_the_command_are_one_line(arguments, message, folder, capsys):
    with pytest.raises(SystemExit) as end:
        command.main(arguments)
    assert end.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
