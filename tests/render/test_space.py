"""What hides what in space, against rays that are followed step by step."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from ocp_envs.picture import Ball, Line, Picture, disc
from ocp_envs.render.space import Space, eye, hidden, layers, outline, portrait

BALL = Ball(np.array([1.0, -2.0, 0.5]), 1.5, "#ff0000", 0.5)
VIEWER = np.array([8.0, -6.0, 5.0])


def space():
    picture = Picture(((-8.0, 8.0),) * 3, lambda state, context: [], lambda states: states[:, :3])
    return Space(Figure(figsize=(5, 5)), (0.0, 0.0, 1.0, 1.0), picture)


def test_rays_from_the_eye_are_seen_as_points():
    projection = space().axes.get_proj()
    viewer = eye(projection)
    assert np.linalg.norm(viewer) > 8.0
    for point in np.random.default_rng(0).uniform(-8, 8, (5, 3)):
        along = viewer + np.linspace(0.3, 1.0, 4)[:, None] * (point - viewer)
        seen = np.column_stack([along, np.ones(4)]) @ projection.T
        seen = seen[:, :2] / seen[:, 3:]
        np.testing.assert_allclose(seen, np.tile(seen[0], (4, 1)), atol=1e-9)


def test_a_point_is_hidden_where_its_ray_passes_the_sphere():
    points = BALL.center + np.random.default_rng(1).uniform(-5, 5, (4000, 3))
    points = points[np.linalg.norm(points - BALL.center, axis=1) > BALL.radius]
    steps = np.linspace(0, 1, 4001)[:, None]
    closest = np.array([np.linalg.norm(VIEWER + steps * (p - VIEWER) - BALL.center, axis=1).min() for p in points])
    clear = np.abs(closest - BALL.radius) > 1e-3
    expected = closest < BALL.radius
    assert 100 < expected.sum() < len(points) - 100
    np.testing.assert_array_equal(hidden(points, BALL, VIEWER)[clear], expected[clear])


def test_what_is_not_a_number_or_behind_the_viewer_is_not_hidden():
    points = np.array([[np.nan] * 3, VIEWER + 3 * (VIEWER - BALL.center)])
    assert not hidden(points, BALL, VIEWER).any()


def test_layers_lie_below_the_farthest_sphere_in_front():
    balls = [Ball(np.array([x, 0.0, 0.0]), 1.0) for x in (-4.0, 0.0, 4.0)]
    points = np.array([[x, 0.0, 0.0] for x in (-8.0, -2.0, 2.0, 6.0)] + [[-8.0, 7.0, 0.0]])
    np.testing.assert_array_equal(layers(points, balls, np.array([20.0, 0.0, 0.0])), [0, 1, 2, 3, 3])
    np.testing.assert_array_equal(layers(points, [], VIEWER), 0)


def test_the_outline_touches_rays_and_sphere():
    for viewer in (VIEWER, BALL.center + np.array([0.0, 0.0, 9.0])):
        circle = outline(BALL, viewer) - BALL.center
        np.testing.assert_allclose(np.linalg.norm(circle, axis=1), BALL.radius)
        np.testing.assert_allclose((circle * (viewer - BALL.center - circle)).sum(axis=1), 0, atol=1e-12)


def test_the_portrait_fills_the_outline():
    projection = space().axes.get_proj()
    image, (left, right, bottom, top) = portrait(BALL, projection, np.array([1.0, 0.0, 0.0]))
    pixels = len(image)
    assert image.min() >= 0
    assert image.max() <= 1
    assert 0.5 <= image[pixels // 2, pixels // 2, 3] < 0.6
    assert image[[0, 0, -1, -1], [0, -1, 0, -1], 3].max() == 0
    seen = np.column_stack([outline(BALL, eye(projection)), np.ones(91)]) @ projection.T
    x, y = (seen[:, :2] / seen[:, 3:]).T
    area = 0.5 * abs((x[:-1] * y[1:] - x[1:] * y[:-1]).sum())
    covered = (image[..., 3] > 0.1).sum() / pixels**2 * (right - left) * (top - bottom)
    assert covered == pytest.approx(area, rel=0.02)
    lit = image[..., 0] * (image[..., 3] > 0.4)
    rows = np.nonzero(lit.max(axis=1) == lit.max())[0]
    assert rows.min() > pixels // 2  # the light comes from above; the first row is the lowest


def test_a_curve_is_drawn_once_wherever_it_runs():
    scene = space()
    curve = scene.curve("trail", color="black")
    scene.show([BALL])
    ray = BALL.center - scene.viewer
    across = np.cross(ray, [0.0, 0.0, 1.0])
    across *= 5 / np.linalg.norm(across)
    points = BALL.center + 3 * ray / np.linalg.norm(ray) + np.linspace(-1, 1, 201)[:, None] * across
    curve.set(points)
    lower, upper = (np.array(piece.get_data_3d()).T for piece in curve._pieces)
    assert curve._pieces[0].zorder < scene._surfaces[0].zorder < curve._pieces[1].zorder
    in_lower, in_upper = np.isfinite(lower).all(axis=1), np.isfinite(upper).all(axis=1)
    assert (in_lower | in_upper).all()
    pieces = (in_lower[:-1] & in_lower[1:]).astype(int) + (in_upper[:-1] & in_upper[1:])
    np.testing.assert_array_equal(pieces, 1)  # every segment, and none twice
    scene.show([])
    assert np.isfinite(curve._pieces[0].get_data_3d()).all()


def test_shadows_lie_on_the_floor():
    scene = space()
    np.testing.assert_array_equal(scene.drop(np.array([[1.0, 2.0, 3.0]])), [[1.0, 2.0, -8.0]])


def test_a_disc_is_round_flat_and_upright():
    center = np.array([1.0, 2.0, 3.0])
    corners = disc(center, 2.0, 13) - center
    assert corners.shape == (13, 3)
    np.testing.assert_allclose(np.linalg.norm(corners, axis=1), 2.0)
    np.testing.assert_allclose(corners[:, 2], 0.0)
    tilt = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(disc(center, 2.0, 13, tilt)[:, 0], 1.0)
    assert Line(corners).points is corners
