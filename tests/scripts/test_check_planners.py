"""The script that checks planners, from end to end at its smallest."""

import sys

import numpy as np
import pytest

import moe_policy
from moe_policy.experiments import checking
from moe_policy.experiments.checking import BoundRow, PlannerChecks
from moe_policy.experiments.checking_tables import (
    BOUND_COLUMNS,
    CHECK_COLUMNS,
    REPAIR_COLUMNS,
    TIME_COLUMNS,
    checked_lines,
    lines,
    repair_lines,
)
from moe_policy.reports.records import ABSENT, read
from moe_policy.reports.tables import markdown_table
from moe_policy.score.method import Method
from ocp_envs.problems.pendulum import PENDULUM
from scripts import check_planners

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
CASES = 6


def run(monkeypatch, folder, *arguments):
    monkeypatch.setattr(sys, "argv", ["check_planners", "--results", str(folder), "--data", str(folder), *arguments])
    check_planners.main()


@pytest.fixture
def few(monkeypatch):
    """One network, one number of iterations, few instances."""
    monkeypatch.setattr(checking, "ITERATIONS", (3,))
    network = Method("snn", moe_policy.load(PENDULUM, "snn"))
    monkeypatch.setattr(check_planners, "shipped", lambda problem: [network])
    monkeypatch.setattr(check_planners, "TIMED", 3)


def test_every_planner_is_measured_on_every_split_and_kept(few, monkeypatch, tmp_path):
    run(monkeypatch, tmp_path, "--cases", str(CASES))
    record = read(tmp_path / "planners_checked_PendulumSwingup-v0.json", PlannerChecks)
    assert list(record.splits) == ["uniform", "boundary", "near", "outside"]
    names = ["optimal", "snn", "snn, repaired, 3 iterations", "checked"]
    for rows in record.splits.values():
        assert [row.row.name for row in rows] == names
        assert all(row.row.metrics.success.total == CASES for row in rows)
        making = rows[-1].making
        assert making is not ABSENT
        assert making.chosen + making.repaired + making.solved + making.abstained == CASES
        assert making.wrong == 0
        assert making.verified == rows[-1].row.metrics.success_at_plan_end.count
    assert [row.name for row in record.times] == names[1:]
    table = markdown_table(lines(record), CHECK_COLUMNS)
    assert f"| uniform, of {CASES} | optimal |" in table
    repaired = repair_lines(record)
    assert [(line.name, list(line.efforts)) for line in repaired] == [("snn", ["", "3 iterations"])] * 4
    assert "| as it is | 3 iterations |" in markdown_table(repaired, REPAIR_COLUMNS).replace("  ", " ")
    assert [line.row.row.name for line in checked_lines(record)] == ["optimal", "checked"] * 4
    assert "a plan, median" in markdown_table(record.times, TIME_COLUMNS)
    assert [row.name for row in record.bounds] == ["snn", "checked"]
    assert all(row.cost_bound is row.coverage is None for row in record.bounds)  # too few instances
    assert "succeeds, at least" in markdown_table(record.bounds, BOUND_COLUMNS)
    # The same command continues: what is finished is not measured again.
    monkeypatch.setattr(checking, "measure", lambda *arguments: pytest.fail("a row that is kept"))
    run(monkeypatch, tmp_path, "--cases", str(CASES))
    again = read(tmp_path / "planners_checked_PendulumSwingup-v0.json", PlannerChecks)
    assert again.splits == record.splits


def test_settings_are_chosen_on_the_development_set(few, monkeypatch, tmp_path):
    run(monkeypatch, tmp_path, "--development", "--cases", "2")
    record = read(tmp_path / "planners_development_PendulumSwingup-v0.json", PlannerChecks)
    assert list(record.splits) == ["development"]


def test_what_is_promised_is_compared_with_fresh_instances():
    rng = np.random.default_rng(0)
    calibration, fresh = 1 + rng.random(999), 1 + rng.random(5000)
    calibration[:20] = fresh[:100] = np.inf
    row = BoundRow.of("planner", calibration, fresh, 0.95)
    assert row.cost_bound == np.sort(calibration)[949]
    assert row.coverage_range[0] < row.coverage.fraction < row.coverage_range[1]
    assert (row.success.count, row.success_measured.count) == (979, 4900)
    assert 0.96 < row.success_bound < 0.979
    assert BoundRow.of("fails", np.full(100, np.inf), fresh, 0.95).coverage is None
