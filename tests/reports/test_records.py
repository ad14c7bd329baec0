from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatch
from pathlib import Path

import pytest

from moe_policy.experiments.between_knots import BetweenKnots
from moe_policy.experiments.borders import Borders
from moe_policy.experiments.budgets import Budgets
from moe_policy.experiments.checking import PlannerChecks
from moe_policy.experiments.cluster_choice import ClusterChoice
from moe_policy.experiments.comparison import Comparison, Margins, Sensitivity
from moe_policy.experiments.data_report import DataReport
from moe_policy.experiments.demonstrations import Datasets
from moe_policy.experiments.discretisation import Discretisation
from moe_policy.experiments.failures import Diagnosis
from moe_policy.experiments.families import Families, FamiliesTable
from moe_policy.experiments.generation import Generation, HardSets, StartTables
from moe_policy.experiments.interruptions import Interruptions
from moe_policy.experiments.latency import Latency
from moe_policy.experiments.learners import LearnerTraining, Search
from moe_policy.experiments.overview import OverviewTable
from moe_policy.experiments.paper_tables import SummaryTable, TrainingTable
from moe_policy.experiments.partitions import Partitions
from moe_policy.experiments.quality import Quality
from moe_policy.experiments.replanning import ReplanningRecord
from moe_policy.experiments.robustness import Robustness
from moe_policy.experiments.seeds import TrainingComparison
from moe_policy.experiments.speed.environments import EnvironmentSpeed, RolloutSpeed
from moe_policy.experiments.speed.exports import Exports
from moe_policy.experiments.speed.generation import GenerationSpeed
from moe_policy.experiments.speed.peers import Peers
from moe_policy.experiments.speed.scaling import Scaling
from moe_policy.experiments.speed.solver import SolverSpeed
from moe_policy.experiments.speed.training import TrainingSpeed
from moe_policy.experiments.splits import SplitComparison
from moe_policy.reports.records import ABSENT, Absent, Record, Scalar, inline, present, read, renamed, write
from moe_policy.score.scoring import Score
from ocp_envs.support.provenance import Provenance, provenance, write_json

RESULTS = Path(__file__).resolve().parents[2] / "results"
FILES = sorted(path.name for path in RESULTS.glob("*.json"))
#: What each file in ``results/`` is, by the pattern of its name; a file has exactly one.
TYPES: dict[str, type[Record]] = {
    "borders_*": Borders,
    "partitions_*": Partitions,
    "clusters_*": ClusterChoice,
    "data_quality_*": Quality,
    "generation_*": Generation,
    "interruptions_*": Interruptions,
    "starts_*": StartTables,
    "data_[GPQ]*": DataReport,
    "between_knots_*": BetweenKnots,
    "discretisation_*": Discretisation,
    "failures_*": Diagnosis,
    "families_*": Families,
    "budgets_*": Budgets,
    "replanning_*": ReplanningRecord,
    "robustness_*": Robustness,
    "compare_splits_*": SplitComparison,
    "minari.json": Datasets,
    "score_*": Score,
    "search_*": Search,
    "splits_*": HardSets,
    "training_*": LearnerTraining,
    "benchmark_env.json": EnvironmentSpeed,
    "benchmark_export.json": Exports,
    "benchmark_generation_*": GenerationSpeed,
    "benchmark_peers.json": Peers,
    "benchmark_planning_*": Latency,
    "benchmark_rollout_*": RolloutSpeed,
    "benchmark_scaling.json": Scaling,
    "benchmark_solver_*": SolverSpeed,
    "benchmark_training.json": TrainingSpeed,
    "compare_[A-Z]*": Comparison,
    "compare_trained_*": Comparison,
    "compare_training_*": TrainingComparison,
    "margin_*": Margins,
    "planners_checked_*": PlannerChecks,
    "sensitivity_*": Sensitivity,
    "stabiliser_*": Sensitivity,
    "table_families.json": FamiliesTable,
    "table_overview.json": OverviewTable,
    "table_summary.json": SummaryTable,
    "table_training.json": TrainingTable,
}


def _patterns(name: str) -> list[str]:
    return [pattern for pattern in TYPES if fnmatch(name, pattern)]


@pytest.mark.parametrize("name", FILES)
def test_every_result_survives_the_round_trip_byte_for_byte(name, tmp_path):
    (pattern,) = _patterns(name)
    write(tmp_path / name, read(RESULTS / name, TYPES[pattern]))
    assert (tmp_path / name).read_bytes() == (RESULTS / name).read_bytes()


@pytest.mark.parametrize("name", FILES)
def test_records_name_their_problem_by_env_id_alone(name):
    """Once, several of them wrote ``problem``."""
    assert '"problem":' not in (RESULTS / name).read_text()
    kind = next((TYPES[pattern] for pattern in _patterns(name) if pattern in TYPES), None)
    names = set() if kind is None else {field.name for field in fields(kind)}
    assert not names & {"problem", "problem_id", "environment"}


def test_no_pattern_is_left_over():
    assert {pattern for name in FILES for pattern in _patterns(name)} == set(TYPES)


@dataclass(frozen=True)
class Point:
    x: float
    y: float


@dataclass(frozen=True)
class Percent:
    of: int

    def to_json(self):
        return {"of": self.of, "fraction": self.of / 100}

    @classmethod
    def from_json(cls, content):
        return cls(content["of"])


@dataclass(frozen=True, kw_only=True)
class Row(Record):
    name: str
    point: Point = inline()
    percent: Percent | None
    seconds: dict[str, float]
    memory: float | Absent | None = ABSENT


@dataclass(frozen=True, kw_only=True)
class Table(Record):
    env_id: str = renamed("problem")
    rows: tuple[Row, ...]
    settings: dict[str, Scalar]
    pair: tuple[int, int] | None
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class Texts(Record):
    label: str
    cells: dict[str, str | None] = inline()


ROW = {"name": "snn", "x": 1, "y": 2.5, "percent": {"of": 7, "fraction": 0.07}, "seconds": {"1": 0.5, "1000": 2}}
TABLE = {
    "problem": "PendulumSwingup-v0",
    "rows": [ROW, ROW | {"percent": None, "memory": None}],
    "settings": {"steps": 3, "rate": 1e-3, "kind": "sac", "on": True, "limit": None},
    "pair": [1, 2],
    "provenance": provenance().to_json(),
}


def test_a_record_has_typed_values_and_writes_what_was_read():
    table = Table.from_json(TABLE)
    assert table.env_id == "PendulumSwingup-v0"
    assert table.rows[0].point == Point(1, 2.5)
    assert table.rows[0].percent == Percent(7)
    assert table.pair == (1, 2)
    assert json.dumps(table.to_json()) == json.dumps(TABLE)
    assert Table.from_json(table.to_json()) == table


def test_an_int_in_a_field_of_floats_stays_an_int():
    assert json.dumps(Row.from_json(ROW | {"x": 1}).to_json()["x"]) == "1"
    assert json.dumps(Row.from_json(ROW | {"x": 1.0}).to_json()["x"]) == "1.0"


def test_an_absent_key_is_not_null_and_stays_absent():
    old, null, new = (Row.from_json(ROW | more) for more in ({}, {"memory": None}, {"memory": 2.0}))
    assert old.memory is ABSENT
    assert "memory" not in old.to_json()
    assert null.to_json()["memory"] is None
    assert [present(row.memory) for row in (old, null, new)] == [None, None, 2.0]


def test_a_record_keeps_the_order_of_its_file_and_a_new_one_that_of_its_fields():
    row = Row.from_json(dict(reversed(ROW.items())))
    assert list(row.to_json()) == list(reversed(ROW))
    assert list(replace(row, memory=1.0).to_json()) == [*ROW, "memory"]


def test_an_inline_dictionary_holds_every_other_key():
    texts = Texts.from_json({"RL": "1", "label": "a", "SNN": None})
    assert texts.cells == {"RL": "1", "SNN": None}
    assert list(texts.to_json().items()) == [("RL", "1"), ("label", "a"), ("SNN", None)]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (ROW | {"seed": 1}, r"unknown key 'seed'; expected the keys name, percent.*add a field to Row.*rows\[1\]"),
        ({key: ROW[key] for key in ROW if key != "seconds"}, "no key 'seconds'"),
        ({key: ROW[key] for key in ROW if key != "y"}, "no key 'y'; expected the keys x, y"),
        (ROW | {"name": 3}, "got 3, expected str"),
        (ROW | {"x": "1"}, "got '1', expected float"),
        (ROW | {"x": True}, "got True, expected float"),
        (ROW | {"x": None}, "got None, expected float"),
        (ROW | {"seconds": {"1": "fast"}}, "got 'fast', expected float"),
        ("snn", "got 'snn', expected an object with the keys name"),
    ],
)
def test_what_is_not_such_a_record_is_refused_with_its_place(row, message, tmp_path):
    path = tmp_path / "table.json"
    write_json(path, TABLE | {"rows": [ROW, row]})
    with pytest.raises(ValueError, match=r"table\.json is not a Table: .*" + message):
        read(path, Table)


def test_numbers_of_numpy_can_be_written(tmp_path):
    numpy = pytest.importorskip("numpy")
    row = Row(name="snn", point=Point(numpy.float64(1), numpy.float32(2)), percent=None, seconds={})
    write(tmp_path / "row.json", row)
    assert read(tmp_path / "row.json", Row).point == Point(1.0, 2.0)
