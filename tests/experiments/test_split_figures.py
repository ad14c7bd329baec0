"""The figure of the splits: what is drawn where."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from moe_policy.experiments.distances import DistanceCurves
from moe_policy.experiments.figures import generalisation as figures
from moe_policy.experiments.splits import SplitComparison, SplitMethod
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support.provenance import provenance
from tests.experiments.test_splits import a_row
from tests.rollouts.test_metrics import episodes


def record_of(problem, splits=("uniform", "boundary", "outside")):
    """A planner that fails close to the jump, and a learner that never does."""
    distances = np.repeat([1e-3, 0.5], 30)
    far = distances > 0.1
    made = {
        "snn": episodes(60, success=far, plan_end_error=np.where(far, 0.01, 1.0), violation=0.2 * ~far),
        "sac": episodes(60),
    }
    rows = [SplitMethod(name=n, splits=dict.fromkeys(splits, a_row(problem, n, run))) for n, run in made.items()]
    return SplitComparison(
        env_id=problem.id,
        splits={},
        rows=tuple(rows),
        curves=DistanceCurves.of(problem, distances, made) if "boundary" in splits else None,
        seconds=0.0,
        provenance=provenance(),
    )


def test_the_pendulum_has_curves_and_marks_for_both_judgements(drawn):
    figure = drawn(figures.splits_figure, PENDULUM, record_of(PENDULUM))
    at_end, on_end, after, on_after = figure.axes
    assert [line.get_label() for line in at_end.lines] == ["snn"]
    assert [line.get_label() for line in after.lines] == ["snn", "sac"]
    np.testing.assert_allclose(after.lines[0].get_xdata(), [1e-3, 0.5])
    np.testing.assert_allclose(after.lines[0].get_ydata(), [0, 100])
    assert after.get_xscale() == "log"
    assert "second best" in after.get_xlabel()
    assert "after terminal regulation" in on_after.get_xlabel()
    assert [text.get_text() for text in on_end.get_yticklabels()] == ["snn", "sac"]
    assert [text.get_text() for text in on_end.get_legend().get_texts()] == ["uniform", "boundary", "outside"]
    # An interval and a mark for each policy and split; three more marks are for the legend.
    assert len(on_after.lines) == 2 * 2 * 3 + 3
    assert len(on_end.lines) == 2 * 3 + 3


def test_bands_enclose_their_curves(drawn):
    axes = drawn(figures.splits_figure, VEHICLE, record_of(VEHICLE)).axes[0]
    assert len(axes.collections) == 2
    for line, band in zip(axes.lines, axes.collections):
        low, high = band.get_paths()[0].get_extents().get_points()[:, 1]
        assert low <= line.get_ydata().min()
        assert line.get_ydata().max() <= high + 1e-9
        assert tuple(band.get_facecolor()[0][:3]) == pytest.approx(figures_color(line), abs=1e-6)


def figures_color(line):
    from matplotlib.colors import to_rgb

    return to_rgb(line.get_color())


def test_without_a_jump_there_are_no_curves(drawn):
    figure = drawn(figures.splits_figure, QUADCOPTER, record_of(QUADCOPTER, ("uniform", "outside")))
    assert len(figure.axes) == 2
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["uniform", "outside"]


def test_round_an_obstacle_violations_start_at_zero(drawn):
    figure = drawn(figures.splits_figure, QUADCOPTER_OBSTACLE, record_of(QUADCOPTER_OBSTACLE))
    on_path = figure.axes[4]
    np.testing.assert_allclose(on_path.lines[0].get_ydata(), [0.2, 0.0])
    assert on_path.get_ylim()[0] == 0
    assert "radii" in on_path.get_xlabel()
    assert "mean violation" in on_path.get_ylabel()


def test_the_file_is_written(tmp_path):
    path = figures.splits_figure(tmp_path / "splits.png", PENDULUM, record_of(PENDULUM))
    assert path.read_bytes().startswith(b"\x89PNG")
