"""The scripts of the splits, from end to end at their smallest."""

import json
import sys

import pytest

import moe_policy
from moe_policy.experiments.benchmark import benchmark_of
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.sets import reference
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.sets.hard_sets import ONE_ROUND, NearEqualCosts, NearGoal, OutsideBox
from ocp_envs.sets.splits import ProblemSets
from scripts import compare_splits, make_splits

FEW = GenerationSettings(first=ONE_ROUND, starts=3, chunk=10)
TINY = {
    "boundary": NearEqualCosts(seed=505, drawn=40, size=3, limit=0.4, slack=0.5, spare=3.0, cheap=FEW, settings=FEW),
    "outside": OutsideBox(seed=606, beyond=(0.0, 0.25), size=3, settings=FEW),
    "near": NearGoal(seed=707, size=3, settings=FEW),
}
compared = pytest.mark.skipif(
    not set(benchmark_of(PENDULUM).planners.compared) <= set(moe_policy.available(PENDULUM.id)),
    reason="needs the shipped models",
)


def run(monkeypatch, module, *arguments):
    monkeypatch.setattr(sys, "argv", [module.__name__, *map(str, arguments)])
    module.main()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Tiny sets and their record, as scripts/make_splits.py makes them."""
    folder = tmp_path_factory.mktemp("splits")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(make_splits, "sets_of", lambda problem: ProblemSets(**TINY))
        folders = ("--data", folder / "data", "--tables", folder / "tables", "--results", folder)
        run(monkeypatch, make_splits, "--workers", 1, *folders)
    return folder


def test_make_splits_ships_sets_and_their_record(made):
    record = json.loads((made / f"splits_{PENDULUM.id}.json").read_text())
    assert set(record) == set(TINY) == set(reference.HARD)
    for name, part in record.items():
        shipped = reference.load(PENDULUM, name, made / "tables")
        assert len(shipped) == part["size"] == 3
        assert part["seed"] == TINY[name].seed
        assert part["seconds"] > 0
        assert part["solves"]["problems"] == part["candidates"]
        assert {"date", "commit", "cores", "versions"} <= set(part["provenance"])
    assert record["boundary"]["drawn"] == 40
    assert (relative_cost_difference(reference.load(PENDULUM, "boundary", made / "tables").mode_costs) < 0.4).all()
    databases = {path.name for path in (made / "data" / PENDULUM.id / "hard").glob("*.zarr")}
    assert databases == {"boundary-candidates.zarr", "boundary.zarr", "outside.zarr", "near.zarr"}


def test_make_splits_does_not_replace_the_packages_sets_by_smaller_ones(monkeypatch, capsys):
    with pytest.raises(SystemExit):
        run(monkeypatch, make_splits, "--cases", 3, "--ship")
    assert "leave --ship out, or name another --tables" in capsys.readouterr().err


@compared
def test_compare_splits(made, monkeypatch, tmp_path, capsys):
    real = reference.load
    tables = dict.fromkeys(reference.HARD, made / "tables")

    def load(problem, name):
        return real(problem, name, tables[name]) if name in tables else real(problem, name)

    monkeypatch.setattr(compare_splits.reference, "load", load)
    run(monkeypatch, compare_splits, "--cases", 30, "--results", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        f"compare_splits_{PENDULUM.id}.json",
        f"splits_{PENDULUM.id}.png",
    }
    record = json.loads((tmp_path / f"compare_splits_{PENDULUM.id}.json").read_text())
    assert {name: split["cases"] for name, split in record["splits"].items()} == {
        "uniform": 30,
        "boundary": 3,
        "near": 3,
        "outside": 3,
    }
    rows = {row["name"]: row for row in record["rows"]}
    assert {"optimal", "nearest", "snn", "moe-custom", "stabiliser"} <= set(rows)
    for split, total in (("uniform", 30), ("boundary", 3), ("outside", 3)):
        assert rows["optimal"][split]["success"]["count"] == total
        assert record["splits"][split]["optimal_solved"] == total
        assert record["splits"][split]["reference_gap"]["within_0.1_percent"] >= total - 1
        assert all(row[split]["judged"]["success"] == row[split]["success"] for row in rows.values())
    curves = record["curves"]
    assert sum(curves["problems"]) + curves["distance_unknown"] == 33
    optimal = curves["metrics"]["success"]["optimal"]
    assert [entry["fraction"] for entry in optimal] == [1.0] * len(curves["problems"])
    assert sum(entry["total"] for entry in optimal) == sum(curves["problems"])
    assert {entry["mixture"] for entry in record["splits"]["uniform"]["separations"]} == {
        name for name in rows if name.startswith("moe-")
    }
    shown = capsys.readouterr().out
    assert "boundary" in shown
    assert "success at the plan's end" in shown


def test_a_split_that_a_problem_has_not_is_refused(monkeypatch, tmp_path, capsys):
    with pytest.raises(SystemExit):
        run(monkeypatch, compare_splits, "--env", QUADCOPTER.id, "--splits", "boundary", "--results", tmp_path)
    assert "has no 'boundary'; there are uniform, near, outside" in capsys.readouterr().err
