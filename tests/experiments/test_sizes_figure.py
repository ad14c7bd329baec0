import dataclasses

import numpy as np
import pytest

from moe_policy.experiments.figures import comparison as figures
from moe_policy.experiments.seeds import TrainingRow
from tests.experiments.test_seeds import model

pytest.importorskip("matplotlib")


def rows_of(success, at_end, violation=None):
    """Two models from three sizes, two seeds each."""
    models = [model(seed, success + seed, violation=violation) for seed in (0, 1)]
    rows = [TrainingRow.of(name, models) for name in ("snn", "moe-custom") for _ in range(3)]
    rows = [dataclasses.replace(row, samples=size) for row, size in zip(rows, (80, 40, 20) * 2)]
    return rows if at_end is None else [dataclasses.replace(row, success_at_plan_end=at_end) for row in rows]


def panels(figure):
    """Title and curves of each panel; a curve is its label, sizes and medians."""
    return {
        axes.get_title(): [(line.get_label(), [*line.get_xdata()], [*line.get_ydata()]) for line in axes.get_lines()]
        for axes in figure.axes
    }


def test_failures_fall_with_the_number_of_instances(drawn):
    found = panels(drawn(figures.sizes_figure, rows_of(90, (40, 50)), cases=100))
    assert set(found) == {"after terminal regulation", "at the plan's end"}
    assert found["after terminal regulation"] == [(name, [20, 40, 80], [9.5] * 3) for name in ("snn", "moe-custom")]
    assert found["at the plan's end"][0] == ("snn", [20, 40, 80], [55.0] * 3)


def test_a_goal_without_regulation_has_one_panel_and_no_failure_is_half_a_failure(drawn):
    found = panels(drawn(figures.sizes_figure, rows_of(99, (99, 100)), cases=100))
    assert set(found) == {"at the plan's end"}
    assert found["at the plan's end"][0][2] == [0.75] * 3


def test_with_path_constraints_violations_are_drawn(drawn):
    found = panels(drawn(figures.sizes_figure, rows_of(90, None, violation=0.25), cases=100))
    assert set(found) == {"at the knots", "on the whole path"}
    assert np.all([values == [0.25] * 3 for curves in found.values() for _, _, values in curves])
