"""What a sphere hides, against rays that are followed step by step."""

from __future__ import annotations

import numpy as np
import pytest

from ocp_envs.picture import Ball
from ocp_envs.render.visibility import eye, hidden, layers, outline, portrait

BALL = Ball(np.array([1.0, -2.0, 0.5]), 1.5, "#ff0000", 0.5)
VIEWER = np.array([8.0, -6.0, 5.0])


def perspective():
    """Matplotlib's projection of a box in space, (4, 4)."""
    figure = pytest.importorskip("matplotlib.figure").Figure(figsize=(5, 5))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    axes.set(xlim=(-8, 8), ylim=(-8, 8), zlim=(-8, 8))
    return axes.get_proj()


def test_rays_from_the_eye_are_seen_as_points():
    projection = perspective()
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
    projection = perspective()
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
