from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from moe_policy.experiments.benchmark.parts import Rise
from moe_policy.experiments.comparison import MarginRow
from moe_policy.experiments.figures import rise, space
from moe_policy.experiments.figures.comparison import margins_figure
from moe_policy.experiments.figures.errors import violations_figure
from moe_policy.experiments.figures.style import COLORS, STYLE, cluster_color
from moe_policy.learning.clustering import Labels, cluster
from ocp_envs.data.samples import Samples
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.trajectory import Trajectory
from tests.experiments.test_overview import row
from tests.small_problems import DOUBLE_INTEGRATOR, with_states
from tests.synthetic import fake_samples

image = pytest.importorskip("matplotlib.image")
colors = pytest.importorskip("matplotlib.colors")

POINTS = 19 * space._PIECES + 1  # of a path
SPHERE = [0.0, 4.0, 4.0]


def straight(p):
    """Straight flights from starts (B, ≥ 3) to the origin in 3 s, through the 20 knots."""
    progress = np.linspace(0, 1, 20)[:, None]
    states = np.zeros((len(p), 20, 12))
    states[..., :3] = p[:, None, :3] * (1 - progress)
    return Trajectory(states, np.ones((len(p), 19, 4)), np.full(len(p), 3.0))


def samples_of(problem, count, seed=0):
    box = problem.parameters
    p = box.draw(np.random.default_rng(seed), count)
    return Samples.of(problem, p, straight(p), np.arange(count) % len(problem.modes.names))


def bent(p, above):
    """Flights from ``p`` that are pushed far up or down half-way: clear of a sphere of radius 3 on the way."""
    plan = straight(p)
    bump = np.where(above, 11.0, -11.0)[:, None] * np.sin(np.linspace(0, np.pi, 20))
    return with_states(plan, np.s_[..., 2], plan.states[..., 2] + bump)


def panels_of(figure):
    return [axes for axes in figure.axes if axes.name == "3d"]


def paths_of(axes):
    """Lines from a start to the goal, or pieces of them where a sphere hides others: colours and (points, 3) data."""
    lines = [(line, np.transpose(line.get_data_3d())) for line in axes.get_lines() if line.get_linestyle() == "-"]
    return [
        (colors.to_hex(line.get_color()), points)
        for line, points in lines
        if len(points) == POINTS and np.isfinite(points).any()
    ]


def starts_of(axes):
    """Dots by colour, without the goal, (n, 3), sorted."""
    dots = [line for line in axes.get_lines() if line.get_marker() == "o" and len(line.get_data_3d()[0]) == 1]
    points = [np.ravel(line.get_data_3d()) for line in dots if colors.to_hex(line.get_color()) != "#000000"]
    return np.array(sorted(tuple(point) for point in points if np.isfinite(point).all()))


def spheres_in(axes):
    return sum(isinstance(child, image.AxesImage) for child in axes.get_children())


def text_of(figure):
    return [text.get_text() for text in figure.texts]


# -- which problems to show --------------------------------------------------------------------------------------------


RISE = Rise(centre=tuple(SPHERE), radius=3.0, start=(0.0, 8.0), heights=(5.0, 9.0), count=5)


def test_the_initial_position_rises_past_a_sphere_at_rest():
    p = rise.rise_parameters(QUADCOPTER_OBSTACLE, RISE)
    np.testing.assert_array_equal(p, [[0, 8, z, 0, 4, 4, 3] for z in (5, 6, 7, 8, 9)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"heights": (5.0, 11.0)}, "outside the box"),
        ({"radius": 0.5}, "outside the box"),
        ({"start": (0.0, 4.0), "heights": (0.0, 8.0)}, r"z = \[2.0, 4.0, 6.0\] are inside the sphere"),
        ({"count": 1}, "expected at least 2 initial positions, got 1"),
    ],
)
def test_sequences_that_make_no_sense_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        rise.rise_parameters(QUADCOPTER_OBSTACLE, dataclasses.replace(RISE, **changes))


def test_a_sequence_needs_a_sphere():
    with pytest.raises(ValueError, match=r"Quadcopter-v0: expected the parameters .*radius.*, got \('x', 'y', 'z'\)"):
        rise.rise_parameters(QUADCOPTER, RISE)


@pytest.mark.parametrize("flip", [0, 3, 8])
def test_the_flip_is_found(flip):
    p = np.linspace([0, 8, 5], [0, 8, 9], 10)
    assert rise.find_discontinuity(bent(p, np.arange(10) > flip)) == flip
    assert rise.find_discontinuity(bent(p, np.arange(10) <= flip)) == flip


def test_of_equal_steps_the_first_is_the_flip():
    states = np.zeros((4, 20, 12))
    states[2:] = 1.0
    steps = Trajectory(np.concatenate([states, states[:1]]), np.zeros((5, 19, 4)), np.ones(5))
    assert rise.find_discontinuity(steps) == 1


def test_steps_are_measured_in_standard_deviations():
    states = np.zeros((4, 20, 12))
    states[1:, :10, 6:10] = 0.1  # forty small components jump after 0
    states[3:, 5, 0] = 100.0  # a large one after 2
    assert rise.find_discontinuity(Trajectory(states, np.zeros((4, 19, 4)), np.ones(4))) == 0


def test_a_flip_needs_two_finite_trajectories():
    plan = straight(np.ones((2, 3)))
    with pytest.raises(ValueError, match="at least two trajectories, got 1"):
        rise.find_discontinuity(plan[0])
    with pytest.raises(ValueError, match="finite; row 1"):
        rise.find_discontinuity(with_states(plan, (1, 3, 4), np.nan))


def test_violations_are_those_of_the_deepest_knot():
    # Through the centre of the first sphere, past the second at a distance of 0.5 m, clear of the third.
    p = np.array([[0, 8, 8, 0, 4, 4, 3.0], [8, 0, 0, 4, 0.5, 0, 2], [0, 0, 8, 5, 5, 5, 1]])
    plans = straight(p)
    to_centre = np.linalg.norm(plans.states[:, :, :3] - p[:, None, 3:6], axis=2).min(axis=1)
    expected = np.maximum(0, p[:, 6] - to_centre)
    assert expected[0] > 2.5
    assert expected[1] == pytest.approx(1.5, abs=0.1)
    assert expected[2] == 0
    np.testing.assert_allclose(rise.plan_violations(QUADCOPTER_OBSTACLE, p, plans), expected, atol=1e-6)
    plans = with_states(plans, (1, 5, 0), np.inf)
    assert np.isnan(rise.plan_violations(QUADCOPTER_OBSTACLE, p, plans)).tolist() == [False, True, False]


def test_violations_need_constraints_and_as_many_plans():
    p = np.array([[0, 8, 8, 0, 4, 4, 3.0]] * 3)
    with pytest.raises(ValueError, match="Quadcopter-v0 has no path constraints"):
        rise.plan_violations(QUADCOPTER, p[:, :3], straight(p))
    with pytest.raises(ValueError, match=r"expected 3 plans of 12 states.* got states of shape \(2, 20, 12\)"):
        rise.plan_violations(QUADCOPTER_OBSTACLE, p, straight(p[:2]))
    with pytest.raises(ValueError, match=r"got states of shape \(3, 25, 2\)"):
        rise.plan_violations(QUADCOPTER_OBSTACLE, p, fake_samples(3).trajectory)


# -- figures -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shown"), [("-+-", "(−, +, −)"), ("cluster 3", "cluster 3"), ("left-hand", "left-hand")]
)
def test_signs_are_set_as_signs(name, shown):
    assert space.cluster_text(name) == shown


@pytest.mark.parametrize("k", [1, 4, 8, 20])
def test_each_cluster_has_a_panel_with_its_samples(drawn, k):
    samples = samples_of(QUADCOPTER, 60)
    labels = Labels(np.arange(60) % k, tuple(f"cluster {i}" for i in range(k)), "test")
    figure = drawn(space.samples_figure, samples, labels, shown=5)
    panels = panels_of(figure)
    assert len(panels) == k
    assert text_of(figure) == [f"cluster {i}: {size}" for i, size in enumerate(labels.sizes)]
    for i, axes in enumerate(panels):
        paths, members = paths_of(axes), samples.parameters[labels.values == i]
        assert {color for color, _ in paths} == {cluster_color(i)}
        assert len(paths) == min(5, len(members))
        for _, path in paths:
            start = np.abs(members - path[0]).max(axis=1).argmin()
            np.testing.assert_allclose(path, members[start] * np.linspace(1, 0, POINTS)[:, None], atol=1e-9)
        np.testing.assert_allclose(starts_of(axes), sorted(tuple(path[0]) for _, path in paths), atol=1e-9)
        (goal,) = (line for line in axes.get_lines() if colors.to_hex(line.get_color()) == "#000000")
        np.testing.assert_array_equal(np.ravel(goal.get_data_3d()), [0, 0, 0])
    # Side by side and below each other, and none beyond the figure.
    boxes = [axes.get_position(original=True) for axes in panels]
    assert all(0 <= box.x0 and box.x1 <= 1 + 1e-9 and 0 <= box.y0 + 1e-9 and box.y1 <= 1 for box in boxes)
    for i, box in enumerate(boxes):
        for other in boxes[:i]:
            apart = (
                min(box.x1, other.x1) <= max(box.x0, other.x0) + 1e-9,
                min(box.y1, other.y1) <= max(box.y0, other.y0) + 1e-9,
            )
            assert any(apart)


def test_the_selection_of_samples_depends_on_the_seed_alone(drawn):
    samples = samples_of(QUADCOPTER_OBSTACLE, 80)
    labels = cluster(samples, "custom")

    def selection(seed):
        return starts_of(panels_of(drawn(space.samples_figure, samples, labels, shown=3, seed=seed))[0]).tolist()

    assert len(selection(0)) == 3
    assert selection(0) == selection(0) != selection(1)


def test_the_nearest_samples_are_drawn_in_the_colour_of_their_cluster(drawn):
    centre = np.array([8, 8, 8, 4, 4, 4, 3.0])
    width = QUADCOPTER_OBSTACLE.parameters.width
    near, far = centre - 0.02 * width * np.eye(7), centre - 0.3 * width * np.eye(7)
    p = np.concatenate([far, near])
    samples = Samples.of(QUADCOPTER_OBSTACLE, p, straight(p), np.array([0] * 7 + [1] * 4 + [2] * 3))
    figure = drawn(space.around_figure, samples, cluster(samples, "custom"), centre, count=7)
    (axes,) = panels_of(figure)
    np.testing.assert_allclose(starts_of(axes), sorted(tuple(start) for start in near[:, :3]))
    drawn_in = {color for color, _ in paths_of(axes)}
    assert drawn_in == {COLORS[1], COLORS[2]}  # none of the seven that are farther
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["(−, −, +): 4", "(−, +, −): 3"]
    assert spheres_in(axes) == 1


def test_nearness_is_measured_in_widths_of_the_box(drawn):
    # 1.0 m of a start is 5 % of its box, 0.6 m of a radius 15 %.
    p = np.array([[8, 8, 8, 4, 4, 4, 3.6], [7, 8, 8, 4, 4, 4, 3.0]])
    samples = Samples.of(QUADCOPTER_OBSTACLE, p, straight(p), np.array([0, 1]))
    labels = cluster(samples, "custom")
    (axes,) = panels_of(drawn(space.around_figure, samples, labels, [8, 8, 8, 4, 4, 4, 3.0], count=1))
    np.testing.assert_allclose(starts_of(axes), [[7, 8, 8]])


def test_without_an_obstacle_there_is_no_sphere(drawn):
    samples = samples_of(QUADCOPTER, 20)
    (axes,) = panels_of(drawn(space.around_figure, samples, cluster(samples, "custom"), [1, 2, 3], count=5))
    assert len(paths_of(axes)) == 5
    assert spheres_in(axes) == 0


P = rise.rise_parameters(QUADCOPTER_OBSTACLE, dataclasses.replace(RISE, heights=(6.0, 9.0), count=7))
OPTIMAL = bent(P, np.arange(7) >= 3)


def test_the_flip_is_shown_for_the_optimum_and_every_planner(drawn):
    plans = {"snn": straight(P), "moe": bent(P, np.arange(7) >= 4)}
    figure = drawn(rise.rise_figure, QUADCOPTER_OBSTACLE, P, OPTIMAL, plans)
    panels = panels_of(figure)
    worst = rise.plan_violations(QUADCOPTER_OBSTACLE, P, plans["snn"]).max()
    assert worst > 2
    titles = {"optimal": 0.0, "snn": worst, "moe": 0.0}
    assert text_of(figure) == [f"{name}\nworst violation {value:.3f} m" for name, value in titles.items()]
    for axes, plan in zip(panels, (OPTIMAL, *plans.values())):
        np.testing.assert_allclose(starts_of(axes), sorted(map(tuple, plan.states[:, 0, :3])), atol=1e-9)
        assert spheres_in(axes) == 1
        assert len({(*axes.get_xlim(), *axes.get_ylim(), *axes.get_zlim()) for axes in panels}) == 1
        spans = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
        np.testing.assert_allclose(spans, spans[0])
    (scale,) = (axes for axes in figure.axes if axes.name != "3d")
    assert [text.get_text() for text in scale.get_yticklabels()] == ["6", "6.5", "7", "7.5", "8", "8.5", "9"]
    assert scale.get_title() == "z, m"
    assert [list(line.get_ydata()) for line in scale.get_lines()] == [[2.5, 2.5]]  # the optimum jumps after 2
    # The colours of the scale are those of the paths, in order.
    order = [colors.to_hex(color) for color in scale.images[0].get_array()[:, 0]]
    dots = {}
    for line in panels[0].get_lines():
        if line.get_marker() == "o" and np.isfinite(line.get_data_3d()).all():
            dots[colors.to_hex(line.get_color())] = np.ravel(line.get_data_3d())
    np.testing.assert_allclose([dots[color] for color in order], P[:, :3])


def test_plans_that_failed_are_left_out(drawn):
    failed = with_states(straight(P), 2, np.nan)
    figure = drawn(rise.rise_figure, QUADCOPTER_OBSTACLE, P, OPTIMAL, {"snn": failed})
    assert [len(starts_of(axes)) for axes in panels_of(figure)] == [7, 6]
    assert text_of(figure)[1] == "snn\nworst violation nan m"


def test_the_share_of_larger_violations(drawn):
    violations = {"snn": np.array([0.3, 0.0, 0.1, 0.2]), "moe": np.array([0.0, 0.0, 0.0, 0.4]), "optimal": [0.0, 0.0]}
    (axes,) = drawn(violations_figure, violations, "four cases").axes
    snn, moe, optimal = (np.asarray(line.get_xydata()) for line in axes.get_lines())
    np.testing.assert_allclose(snn, [[0, 100], [0, 75], [0.1, 50], [0.2, 25], [0.3, 0]])
    np.testing.assert_allclose(moe[[-2, -1]], [[0, 25], [0.4, 0]])
    np.testing.assert_allclose(optimal[-1], [0, 0])
    assert axes.get_yscale() == "log"
    assert axes.get_ylim()[0] < 25  # a single case is seen
    assert axes.get_title() == "four cases"
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["snn: mean 0.150 m", "moe: mean 0.100 m", "optimal: mean 0.000 m"]


def test_files_are_pictures_of_the_right_size(tmp_path):
    samples = samples_of(QUADCOPTER_OBSTACLE, 16)
    labels = cluster(samples, "custom")
    problem, middle = QUADCOPTER_OBSTACLE, [8, 8, 8, 4, 4, 4, 3]
    written = {
        (8.9, 4.7): space.samples_figure(tmp_path / "new" / "samples.png", samples, labels),
        (6.8, 4.6): space.around_figure(tmp_path / "around.png", samples, labels, middle, count=10),
        (6.9, 3.2): rise.rise_figure(tmp_path / "flip.png", problem, P, OPTIMAL, {"snn": straight(P)}),
        (5.6, 3.6): violations_figure(tmp_path / "violations.png", {"snn": np.linspace(0, 1, 9)}, "title"),
    }
    for inches, path in written.items():
        picture = image.imread(path)[..., :3]
        expected = [round(length * STYLE["savefig.dpi"]) for length in inches]
        assert picture.shape[1::-1] == pytest.approx(expected, abs=1)
        assert np.ptp(picture) > 0.9
        assert (picture.min(axis=2) < 0.9).mean() > 0.01


# -- errors ------------------------------------------------------------------------------------------------------------


def test_a_picture_in_space_is_needed(tmp_path):
    samples = fake_samples(10)
    labels, path = cluster(samples, "custom"), tmp_path / "no.png"
    with pytest.raises(ValueError, match=r"PendulumSwingup-v0.*picture in space"):
        space.samples_figure(path, samples, labels)
    with pytest.raises(ValueError, match="picture in space"):
        space.around_figure(path, samples, labels, [0.0, 0.0])
    with pytest.raises(ValueError, match=r"DoubleIntegrator-v0.*picture in space"):
        space.picture_of(DOUBLE_INTEGRATOR)
    assert not path.exists()


def test_samples_that_do_not_fit_are_refused(tmp_path):
    samples = samples_of(QUADCOPTER_OBSTACLE, 16)
    labels, path, p = cluster(samples, "custom"), tmp_path / "no.png", samples.parameters[0]
    with pytest.raises(ValueError, match=r"k: expected a whole number in 1 … 16, got 40"):
        space.around_figure(path, samples, labels, p)
    with pytest.raises(ValueError, match=r"one parameter \(7,\), got \(2, 7\)"):
        space.around_figure(path, samples, labels, samples.parameters[:2])
    with pytest.raises(ValueError, match=r"\(B, 7\) or \(7,\), got \(3,\)"):
        space.around_figure(path, samples, labels, p[:3])
    assert not path.exists()


def test_plans_that_do_not_fit_are_refused(tmp_path):
    path, problem = tmp_path / "no.png", QUADCOPTER_OBSTACLE
    with pytest.raises(ValueError, match="expected 7 plans"):
        rise.rise_figure(path, problem, P, OPTIMAL, {"snn": straight(P[1:])})
    other = P.copy()
    other[3, 6] = 2.5
    with pytest.raises(ValueError, match=r"one \(cx, cy, cz, radius\) for all"):
        rise.rise_figure(path, problem, other, OPTIMAL, {})
    with pytest.raises(ValueError, match="Quadcopter-v0 has no path constraints"):
        rise.rise_figure(path, QUADCOPTER, P[:, :3], OPTIMAL, {})
    assert not path.exists()


@pytest.mark.parametrize(
    ("violations", "message"),
    [
        ({}, "1 to 8 models, got"),
        ({str(i): [0.0] for i in range(9)}, "1 to 8 models, got"),
    ],
)
def test_violations_of_no_model_or_of_too_many_are_refused(tmp_path, violations, message):
    with pytest.raises(ValueError, match=message):
        violations_figure(tmp_path / "no.png", violations, "title")
    assert not (tmp_path / "no.png").exists()


# -- margins -----------------------------------------------------------------------------------------------------------


def test_margins_are_curves_of_violation_against_cost_and_the_optimum_is_a_star(drawn):
    rows = [
        MarginRow(margin=None, row=row("optimal", 10, 10, 1.0, 0.0)),
        *(MarginRow(margin=margin, row=row("snn", 9, 9, 1 + margin, 0.5 - margin)) for margin in (0.0, 0.25)),
    ]
    (axes,) = drawn(margins_figure, rows).axes
    optimum, curve = axes.get_lines()
    assert (optimum.get_marker(), *optimum.get_xydata()[0]) == ("*", 0.0, 0.0)
    np.testing.assert_allclose(curve.get_xydata(), [[0.0, 0.5], [25.0, 0.25]])
    assert [text.get_text() for text in axes.texts] == ["0", "0.25"]
