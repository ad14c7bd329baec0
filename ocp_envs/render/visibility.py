"""What a sphere hides, and how it looks: the geometry of drawing in space, without Matplotlib.

A point p is hidden by the sphere of centre c and radius r from the eye e if its ray meets the sphere,

    ((p − e)·(c − e))² > ‖p − e‖² (‖c − e‖² − r²)   with   (p − e)·(c − e) > 0,

and p lies beyond the plane of the circle in which the rays touch it, (p − c)·(e − c) < r². This is exact for a point
outside the sphere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocp_envs.picture import Ball
from ocp_envs.support.arrays import Array, Bools, Ints

_LIGHT = np.array([-0.35, -0.55, 0.76]) / np.linalg.norm([-0.35, -0.55, 0.76])  # direction towards the light


def eye(projection: Array) -> Array:
    """The point (3,) from which a perspective ``projection`` (4, 4) looks, which has no image in the picture."""
    point = np.linalg.svd(projection[[0, 1, 3]])[2][-1]
    return np.asarray(point[:3] / point[3])


def hidden(points: Array, ball: Ball, viewer: Array) -> Bools:
    """Whether ``ball`` hides ``points`` (n, 3) from ``viewer`` (3,); non-finite points are not hidden."""
    rays, axis = points - viewer, ball.center - viewer
    along = rays @ axis
    meets = (along > 0) & (along**2 > (rays**2).sum(axis=1) * (axis @ axis - ball.radius**2))
    return np.asarray(meets & ((ball.center - points) @ axis < ball.radius**2))


def layers(points: Array, balls: Sequence[Ball], viewer: Array) -> Ints:
    """The layer (n,) in which each of ``points`` (n, 3) is drawn, seen by a ``viewer`` (3,).

    It is the index of the first of ``balls``, ordered from far to near, that hides the point, or their number if none
    does.
    """
    layer = np.full(len(points), len(balls))
    for k in reversed(range(len(balls))):
        layer[hidden(points, balls[k], viewer)] = k
    return layer


def portrait(ball: Ball, projection: Array, color: Array, pixels: int = 160) -> tuple[Array, Array]:
    """An image (``pixels``, ``pixels``, 4) of ``ball``, and its extent (left, right, bottom, top) in ``projection``.

    It is cast ray by ray: the normal where a pixel's ray meets the sphere gives the brightness. A mesh of translucent
    facets would show its edges, because neighbours overlap there. ``projection`` is a perspective, (4, 4), and
    ``color`` is red, green, blue in [0, 1], (3,).
    """
    viewer = eye(projection)
    extent = _extent(ball, projection, viewer, pixels)
    rays = _rays(extent, projection, viewer, _project(ball.center[None], projection)[0, 2], pixels)
    offset = viewer - ball.center
    half = rays @ offset
    root = half**2 - offset @ offset + ball.radius**2
    normals = (offset + (-half - np.sqrt(np.maximum(root, 0)))[..., None] * rays) / ball.radius
    facing = np.clip(-(normals * rays).sum(axis=-1), 0, 1)
    lit = np.clip(normals @ _LIGHT, 0, 1)[..., None]
    image = np.empty((pixels, pixels, 4))
    image[..., :3] = color * (0.6 + 0.4 * lit)
    image[..., :3] += (1 - image[..., :3]) * 0.5 * lit**8  # a soft highlight
    # The sphere looks denser at a grazing angle; its rim fades out within a pixel or two.
    density = ball.alpha + (1 - ball.alpha) * 0.6 * (1 - facing) ** 2
    rim = np.clip(root / ball.radius**2 * pixels / 4, 0, 1)
    image[..., 3] = density * rim
    return np.clip(image, 0, 1), extent


def _extent(ball: Ball, projection: Array, viewer: Array, pixels: int) -> Array:
    """Left, right, bottom and top of the projected sphere, with a margin of two pixels."""
    corners = _project(outline(ball, viewer), projection)[:, :2]
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    margin = 2 / pixels * np.array([right - left, top - bottom])
    return np.array([left - margin[0], right + margin[0], bottom - margin[1], top + margin[1]])


def _rays(extent: Array, projection: Array, viewer: Array, depth: float, pixels: int) -> Array:
    """Unit vectors (pixels, pixels, 3) from the viewer through the pixels of an image at ``depth``."""
    width, height = (extent[1] - extent[0]) / pixels, (extent[3] - extent[2]) / pixels
    x = extent[0] + width * (np.arange(pixels) + 0.5)
    y = extent[2] + height * (np.arange(pixels) + 0.5)
    seen = np.stack([*np.meshgrid(x, y), np.full((pixels, pixels), depth), np.ones((pixels, pixels))], axis=-1)
    world = seen @ np.linalg.inv(projection).T
    rays = world[..., :3] / world[..., 3:] - viewer
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.asarray(rays)


def _project(points: Array, projection: Array) -> Array:
    seen = np.column_stack([points, np.ones(len(points))]) @ projection.T
    return np.asarray(seen[:, :3] / seen[:, 3:])


def outline(ball: Ball, viewer: Array) -> Array:
    """The silhouette of ``ball``: the circle (n, 3) in which rays from ``viewer`` (3,) touch it."""
    towards = viewer - ball.center
    distance = float(np.linalg.norm(towards))
    towards = towards / distance
    side = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    side /= np.linalg.norm(side)
    up = np.cross(side, towards)
    sine = ball.radius / distance
    angle = np.linspace(0, 2 * np.pi, 91)[:, None]
    circle = np.cos(angle) * side + np.sin(angle) * up
    return np.asarray(ball.center + ball.radius * (sine * towards + np.sqrt(1 - sine**2) * circle))
