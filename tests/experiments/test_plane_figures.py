from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from moe_policy.experiments.figures import clusters, plane
from moe_policy.experiments.figures.errors import error_histograms_figure
from moe_policy.experiments.figures.style import COLORS, STYLE, coordinate_text
from moe_policy.learning.clustering import Labels, cluster
from ocp_envs.data.samples import Samples
from ocp_envs.goal import SINGLE_MODE
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, rest_to_rest
from tests.synthetic import fake_samples

image = pytest.importorskip("matplotlib.image")
colors = pytest.importorskip("matplotlib.colors")


def vehicle_samples(modes, seed=0):
    """Straight drives to the winding of each mode, with the sign of the speed of its direction."""
    modes = np.asarray(modes, dtype=np.int64)
    box = VEHICLE.parameters
    p = box.draw(np.random.default_rng(seed), len(modes))
    p[:, 3] = np.where(modes % 2 == 1, 1.0, -1.0)
    progress = np.linspace(0, 1, VEHICLE.knots)[:, None]
    states = p[:, None] * (1 - progress) + VEHICLE.targets[modes // 2][:, None] * progress
    return Samples.of(VEHICLE, p, Trajectory(states, np.zeros((len(p), 24, 2)), np.full(len(p), 4.0)), modes)


def mass_samples():
    states, controls, duration = rest_to_rest(np.linspace(-4, 4, 8), 5.0, DOUBLE_INTEGRATOR.knots)
    trajectory = Trajectory(states, controls, duration)
    return Samples.of(DOUBLE_INTEGRATOR, states[:, 0], trajectory, np.zeros(8, np.int64))


def lines_of(axes, points):
    """Lines of so many points: their colours and their (points, 2) data."""
    chosen = [line for line in axes.get_lines() if len(line.get_xdata()) == points]
    return [(colors.to_hex(line.get_color()), np.asarray(line.get_xydata())) for line in chosen]


# -- text --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("theta_f = -2 pi, backwards", "$θ_f$ = −2π, backwards"),
        ("theta_f = 0 pi, forwards", "$θ_f$ = 0, forwards"),
        ("theta_f = 10 pi", "$θ_f$ = 10π"),
        ("theta_f = -pi", "$θ_f$ = −π"),
        ("left-hand side", "left-hand side"),
        ("cluster 10", "cluster 10"),
        ("epigraph", "epigraph"),
    ],
)
def test_names_are_set_as_formulas(name, shown):
    assert coordinate_text(name) == shown


def test_the_coordinate_that_tells_windings_apart():
    assert plane.winding_coordinate(PENDULUM) == 0
    assert plane.winding_coordinate(VEHICLE) == 2
    assert plane.winding_coordinate(DOUBLE_INTEGRATOR) == 0
    once = dataclasses.replace(VEHICLE.goal, windings=[[0, 0, 0, 0]])
    assert plane.winding_coordinate(dataclasses.replace(VEHICLE, goal=once, modes=SINGLE_MODE)) == 2  # the periodic one


# -- the chosen case ---------------------------------------------------------------------------------------------------

FIRST, BETWEEN, TRIPLE = 1.0, np.pi / 2, 3.0  # θ_0 of cases: all neighbours of one mode, of two, of three
#: (number of θ_0, modes of the training samples there)
GROUPS = {FIRST: (0, 0, 0), BETWEEN: (0, 0, 1), TRIPLE: (2, 1, 0)}
TRAINING = Samples.of(
    PENDULUM,
    np.array([[angle, 0.01 * i] for angle in GROUPS for i in range(3)]),
    fake_samples(9).trajectory,
    np.array([mode for modes in GROUPS.values() for mode in modes]),
)


def choose(cases):
    """The choice among cases (θ_0, final angle of the single network, of the mixture); optimal plans end at π."""
    angles, single, mixture = np.array(cases, dtype=np.float64).T

    def ending_at(final):
        states = np.zeros((len(final), PENDULUM.knots, 2))
        states[:, -1, 0] = final
        return Trajectory(states, np.zeros((len(final), PENDULUM.knots - 1, 1)), np.ones(len(final)))

    p = np.stack([angles, np.zeros(len(angles))], axis=1)
    optimal = ending_at(np.full(len(angles), np.pi))
    validation = Samples.of(PENDULUM, p, optimal, np.ones(len(p), np.int64))
    return plane.choose_interpolated(validation, lambda _: ending_at(single), lambda _: ending_at(mixture), TRAINING, 3)


GOOD = np.pi + 0.05  # within the radius of 0.1 of the optimal end
HALFWAY = 2 * np.pi  # between π and 3π


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        pytest.param((TRIPLE, HALFWAY - 1, GOOD), (BETWEEN, HALFWAY, GOOD), id="three modes before two"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (FIRST, HALFWAY, GOOD), id="two modes before one"),
        pytest.param((BETWEEN, HALFWAY, GOOD), (BETWEEN, HALFWAY - 0.5, GOOD), id="the end farther from the goals"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (TRIPLE, HALFWAY, np.pi + 0.2), id="a mixture at the optimal end"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (TRIPLE, HALFWAY, GOOD + 2 * np.pi), id="a turn is not nothing"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (TRIPLE, np.pi + 0.09, GOOD), id="a single network that fails"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (TRIPLE, 3 * np.pi + 2, GOOD), id="between, not beyond"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (TRIPLE, np.nan, GOOD), id="a plan that is finite"),
        pytest.param((BETWEEN, HALFWAY - 2, GOOD), (TRIPLE, HALFWAY, np.nan), id="a mixture that is finite"),
        pytest.param((FIRST, np.pi, GOOD), (TRIPLE, HALFWAY, 0.0), id="where nothing fits, a mixture that succeeds"),
    ],
)
def test_the_case_between_families_is_chosen(better, worse):
    assert choose([better, worse]) == 0
    assert choose([worse, better]) == 1


def test_ties_go_to_the_first_case():
    assert choose([(FIRST, HALFWAY, GOOD), *[(TRIPLE, HALFWAY, GOOD)] * 5]) == 1


# -- figures -----------------------------------------------------------------------------------------------------------


def test_samples_are_drawn_in_the_colour_of_their_cluster(drawn):
    samples = vehicle_samples(np.arange(60) % 6)
    figure = drawn(plane.samples_figure, samples, cluster(samples, "custom"), shown=60)
    (axes,) = figure.axes
    paths = lines_of(axes, VEHICLE.knots)
    assert len(paths) == 60
    for color, path in paths:
        (row,) = np.flatnonzero((samples.parameters[:, :2] == path[0]).all(axis=1))
        np.testing.assert_array_equal(path, samples.trajectory.states[row, :, :2])
        assert color == COLORS[samples.mode[row]]
    starts = {tuple(point[0]) for _, point in lines_of(axes, 1)}
    assert starts == {*map(tuple, samples.parameters[:, :2]), (0.0, 0.0)}  # and the goal
    assert axes.get_aspect() == 1.0
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[0] == "$θ_f$ = −2π, backwards (10)"
    assert names[-1] == "goal"
    assert len(names) == 7


def test_the_selection_of_samples_depends_on_the_seed_alone(drawn):
    samples = vehicle_samples(np.arange(60) % 6)
    labels = cluster(samples, "custom")

    def selection(seed):
        (axes,) = drawn(plane.samples_figure, samples, labels, shown=10, seed=seed).axes
        return {tuple(path[0]) for _, path in lines_of(axes, VEHICLE.knots)}

    assert len(selection(0)) == 10
    assert selection(0) == selection(0) != selection(1)


def test_interpolation_shows_neighbours_and_predictions(drawn):
    around = vehicle_samples([0, 3, 3])
    plans = vehicle_samples([3, 3, 3], seed=1).trajectory
    predictions = {"snn": plans[1], "moe": plans[2]}
    figure = drawn(plane.interpolation_figure, plans[0], around, predictions, VEHICLE)
    left, history = figure.axes
    expected = [COLORS[0], COLORS[3], COLORS[3], "#000000"]
    for axes, values in ((left, plans.states[..., :2]), (history, np.stack([plans.times, plans.states[..., 2]], 2))):
        lines = lines_of(axes, VEHICLE.knots)
        assert [color for color, _ in lines][:4] == expected
        assert len({color for color, _ in lines}) == 5  # both predictions in colours of their own
        for (_, line), value in zip(lines[3:], values):
            np.testing.assert_array_equal(line, value)
        dashed = [line.is_dashed() for line in axes.get_lines() if len(line.get_xdata()) == VEHICLE.knots]
        assert dashed == [False] * 4 + [True] * 2
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[:3] == ["optimal", "snn", "moe"]
    assert names[-2:] == ["$θ_f$ = −2π, backwards (1)", "$θ_f$ = 0, forwards (2)"]
    windings = [line for line in history.get_lines() if line.get_linestyle() == ":"]
    np.testing.assert_allclose([line.get_ydata()[0] for line in windings], [-2 * np.pi, 0, 2 * np.pi])
    assert history.get_ylabel() == "θ, rad"
    assert {"−2π", "−π", "0"} <= {text.get_text() for text in history.get_yticklabels()}


def test_histories_have_a_row_for_each_coordinate_and_a_column_for_each_cluster(drawn):
    samples = vehicle_samples([1] * 30 + [3] * 5)
    figure = drawn(clusters.histories_figure, samples, cluster(samples, "custom"), shown=20)
    assert len(figure.axes) == 4 * 2
    grid = np.reshape(figure.axes, (4, 2))
    for column, (mode, count) in enumerate(((1, 20), (3, 5))):
        for row in range(4):
            lines = lines_of(grid[row, column], VEHICLE.knots)
            assert [color for color, _ in lines] == [COLORS[column]] * count
            members = samples.trajectory.states[samples.mode == mode][..., row]
            assert all((line[:, 1] == members).all(axis=1).any() for _, line in lines)
            assert all(line[-1, 0] == 4.0 for _, line in lines)
    assert [axes.get_ylabel() for axes in grid[:, 0]] == ["x, m", "y, m", "θ, rad", "v, m/s"]
    assert grid[0, 0].get_title() == "$θ_f$ = −2π\nforwards\n(30)"


def test_histograms_count_every_case_and_the_failures(drawn):
    rng = np.random.default_rng(0)
    snn = rng.lognormal(-1, 1, 200), np.array([*np.full(197, 1e-9), np.nan, np.inf, 0.5])
    moe = np.full(200, 0.01), np.full(200, 0.02)
    figure = drawn(error_histograms_figure, {"snn": snn, "moe": moe}, 0.5)
    assert len(figure.axes) == 2
    for axes, pair in zip(figure.axes, (snn, moe)):
        heights = [patch.get_height() for patch in axes.patches if hasattr(patch, "get_height")]
        assert sum(heights) == 400  # none is lost: neither those of no error nor those that are not finite
        title = axes.get_title().splitlines()
        failures = [int((~(part < 0.5)).sum()) for part in pair]
        assert title[1] == f"predicted {failures[0]}, tracked {failures[1]}"
        assert axes.get_xscale() == "log"
        assert 0.5 in [line.get_xdata()[0] for line in axes.get_lines() if line.get_linestyle() == "--"]
    assert figure.axes[0].get_title().startswith("snn, 200 cases")
    assert "tracked 3" in figure.axes[0].get_title()


def test_files_are_pictures_of_the_right_size(tmp_path):
    samples = fake_samples(30, modes=3)
    labels = cluster(samples, "custom")
    plan = samples.trajectory[0]
    errors = {"snn": (np.full(5, 0.2), np.full(5, 0.3))}
    written = {
        (7.4, 5.0): plane.samples_figure(tmp_path / "new" / "samples.png", samples, labels),
        (10.0, 3.8): plane.interpolation_figure(tmp_path / "between.png", plan, samples, {"snn": plan}, PENDULUM),
        (5.4, 3.6): clusters.histories_figure(tmp_path / "histories.png", samples, labels),
        (5.2, 3.2): error_histograms_figure(tmp_path / "errors.png", errors, 0.1),
    }
    for inches, path in written.items():
        picture = image.imread(path)[..., :3]
        expected = [round(length * STYLE["savefig.dpi"]) for length in inches]
        assert picture.shape[1::-1] == pytest.approx(expected, abs=1)
        assert np.ptp(picture) == 1.0


# -- errors ------------------------------------------------------------------------------------------------------------


def test_a_problem_without_a_picture_is_refused_where_one_is_needed(tmp_path, drawn):
    samples = mass_samples()
    labels = Labels(np.arange(8) % 2, ("left", "right"), "custom")
    with pytest.raises(ValueError, match=r"DoubleIntegrator-v0.*histories_figure"):
        plane.samples_figure(tmp_path / "no.png", samples, labels)
    with pytest.raises(ValueError, match="picture"):
        plane.interpolation_figure(tmp_path / "no.png", samples.trajectory[0], samples, {}, DOUBLE_INTEGRATOR)
    assert len(drawn(clusters.histories_figure, samples, labels).axes) == 2 * 2  # this one needs none


def test_errors_without_a_finite_value_are_refused(tmp_path):
    with pytest.raises(ValueError, match="finite"):
        error_histograms_figure(tmp_path / "no.png", {"snn": (np.full(3, np.nan), np.full(3, np.inf))}, 0.1)
    assert not (tmp_path / "no.png").exists()
