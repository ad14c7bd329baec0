import pytest

from moe_policy.reports.records import ABSENT
from moe_policy.reports.tables import Column, duration, markdown_table, proportion, text_table
from moe_policy.rollouts.intervals import Proportion

ROWS = [
    {"name": "optimal", "success": Proportion(1000, 1000), "error": 0.00123},
    {"name": "a|b", "success": Proportion(0, 1000), "error": None},
    {"name": "sac", "success": Proportion(985, 1000), "error": float("nan")},
]
COLUMNS = [
    Column("policy", lambda row: row["name"]),
    Column("success", lambda row: row["success"], proportion),
    Column("error", lambda row: row["error"], ".2e"),
]
NOTHING = Column("nothing", lambda row: ABSENT)


def test_missing_values_are_dashes():
    assert markdown_table([{"x": 1}, {}], [Column("x", lambda row: row.get("x"))]).splitlines()[-2:] == [
        "| 1 |",
        "| – |",
    ]


def test_columns_without_a_value_are_left_out():
    assert markdown_table(ROWS, [*COLUMNS, NOTHING]) == markdown_table(ROWS, COLUMNS)
    assert text_table(ROWS, [NOTHING, *COLUMNS]) == text_table(ROWS, COLUMNS)
    assert "nothing" in text_table([], [NOTHING])


def test_markdown():
    assert markdown_table(ROWS, COLUMNS).splitlines() == [
        "| policy | success | error |",
        "| --- | ---: | ---: |",
        "| optimal | 1000 (99.6–100.0 %) | 1.23e-03 |",
        "| a\\|b | 0 (0.0–0.4 %) | – |",
        "| sac | 985 (97.5–99.1 %) | – |",
    ]


def test_text_is_aligned():
    lines = text_table(ROWS, COLUMNS).splitlines()
    assert lines[0].split() == ["policy", "success", "error"]
    assert len({len(line) for line in lines}) == 1
    assert lines[2].startswith("optimal  ")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(3.2e-7, "0.32 µs"), (1.23e-5, "12.3 µs"), (0.00456, "4.56 ms"), (7.89, "7.89 s"), (738, "12.3 min")],
)
def test_durations(seconds, text):
    assert duration(seconds) == text
