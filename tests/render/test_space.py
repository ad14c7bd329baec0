"""Axes in space: curves split by what hides them, shadows."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from ocp_envs.picture import Ball, Line, Picture, disc
from ocp_envs.render.space import Space

BALL = Ball(np.array([1.0, -2.0, 0.5]), 1.5, "#ff0000", 0.5)


def space():
    picture = Picture(((-8.0, 8.0),) * 3, lambda state, context: [], lambda states: states[:, :3])
    return Space(Figure(figsize=(5, 5)), (0.0, 0.0, 1.0, 1.0), picture)


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
