"""Drawing in space: Matplotlib's axes in three dimensions, with the order of drawing worked out here.

Matplotlib sorts whole artists by depth and draws every line below every surface. A path that goes round a sphere needs
more: a point p is hidden by the sphere of centre c and radius r from the eye e if its ray meets the sphere,

    ((p − e)·(c − e))² > ‖p − e‖² (‖c − e‖² − r²)   with   (p − e)·(c − e) > 0,

and p lies beyond the plane of the circle in which the rays touch it, (p − c)·(e − c) < r². That is exact for a point
outside the sphere. The spheres are drawn from far to near, and every piece of a line in the layer below the farthest
sphere that hides it. Shadows fall straight down to the floor, so that a still picture tells how high and how far.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ocp_envs.picture import Ball, Face, Line, Picture, Shape, disc
from ocp_envs.support.arrays import Array

_SHADOW = "#8a8f98"
_LIGHT = np.array([-0.35, -0.55, 0.76]) / np.linalg.norm([-0.35, -0.55, 0.76])  # where it comes from
_LAYER = 10.0  # zorder from one sphere to the next
#: zorder within a layer.
RANKS = {"shadow": 0.5, "goal": 1.0, "plan": 2.0, "trail": 3.0, "body": 5.0}


def eye(projection: Array) -> Array:
    """The point (3,) that a perspective ``projection`` (4, 4) looks from: what it maps to no point of the picture."""
    point = np.linalg.svd(projection[[0, 1, 3]])[2][-1]
    return np.asarray(point[:3] / point[3])


def hidden(points: Array, ball: Ball, viewer: Array) -> NDArray[np.bool_]:
    """Whether ``ball`` hides ``points`` (n, 3) from ``viewer`` (3,); see the module. Not a number: no."""
    rays, axis = points - viewer, ball.center - viewer
    along = rays @ axis
    meets = (along > 0) & (along**2 > (rays**2).sum(axis=1) * (axis @ axis - ball.radius**2))
    return np.asarray(meets & ((ball.center - points) @ axis < ball.radius**2))


def layers(points: Array, balls: Sequence[Ball], viewer: Array) -> NDArray[np.int64]:
    """Of ``points`` (n, 3): the index of the first of ``balls``, from far to near, that hides them, or their number."""
    layer = np.full(len(points), len(balls))
    for k in reversed(range(len(balls))):
        layer[hidden(points, balls[k], viewer)] = k
    return layer


def portrait(ball: Ball, projection: Array, color: Array, pixels: int = 160) -> tuple[Array, Array]:
    """A sphere as it is seen: an image (pixels, pixels, 4) and its extent (left, right, bottom, top) in the projection.

    Each pixel's ray meets the sphere or not; where it does, the normal tells how bright it is. Facets would show as a
    mesh, as translucent neighbours overlap at their edges.

    Args:
        ball: the sphere.
        projection: (4, 4), in perspective.
        color: (3,).
        pixels: along either side.
    """
    viewer = eye(projection)
    corners = _project(outline(ball, viewer), projection)[:, :2]
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    margin = 2 / pixels * np.array([right - left, top - bottom])
    extent = np.array([left - margin[0], right + margin[0], bottom - margin[1], top + margin[1]])
    width, height = (extent[1] - extent[0]) / pixels, (extent[3] - extent[2]) / pixels
    x = extent[0] + width * (np.arange(pixels) + 0.5)
    y = extent[2] + height * (np.arange(pixels) + 0.5)
    depth = _project(ball.center[None], projection)[0, 2]
    seen = np.stack([*np.meshgrid(x, y), np.full((pixels, pixels), depth), np.ones((pixels, pixels))], axis=-1)
    world = seen @ np.linalg.inv(projection).T
    rays = world[..., :3] / world[..., 3:] - viewer
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    offset = viewer - ball.center
    half = rays @ offset
    root = half**2 - offset @ offset + ball.radius**2
    normals = (offset + (-half - np.sqrt(np.maximum(root, 0)))[..., None] * rays) / ball.radius
    facing = np.clip(-(normals * rays).sum(axis=-1), 0, 1)
    lit = np.clip(normals @ _LIGHT, 0, 1)[..., None]
    image = np.empty((pixels, pixels, 4))
    image[..., :3] = color * (0.6 + 0.4 * lit)
    image[..., :3] += (1 - image[..., :3]) * 0.5 * lit**8  # a soft highlight
    # Seen at a grazing angle it looks denser; the rim fades out within a pixel or two.
    density = ball.alpha + (1 - ball.alpha) * 0.6 * (1 - facing) ** 2
    rim = np.clip(root / ball.radius**2 * pixels / 4, 0, 1)
    image[..., 3] = density * rim
    return np.clip(image, 0, 1), extent


def _project(points: Array, projection: Array) -> Array:
    seen = np.column_stack([points, np.ones(len(points))]) @ projection.T
    return np.asarray(seen[:, :3] / seen[:, 3:])


def outline(ball: Ball, viewer: Array) -> Array:
    """The circle (n, 3) in which the rays from ``viewer`` touch a sphere: its silhouette."""
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


class Curve:
    """A line in pieces, each in the layer of what it is behind of."""

    def __init__(self, space: Space, rank: float, style: dict[str, Any]) -> None:
        self._space, self._rank, self._style = space, rank, style
        self._points = np.empty((0, 3))
        self._pieces: list[Any] = []

    def set(self, points: Array, **style: Any) -> None:
        """Go through ``points`` (n, 3) from now on."""
        self._points = points
        for piece in self._pieces:
            piece.set(**style)
        self._style.update(style)
        self.refresh()

    def refresh(self) -> None:
        """Sort the pieces anew."""
        points, balls = self._points, self._space.balls
        while len(self._pieces) <= len(balls):
            zorder = _LAYER * len(self._pieces) + self._rank
            (piece,) = self._space.axes.plot([], [], [], zorder=zorder, **self._style)
            self._pieces.append(piece)
        layer = layers(points, balls, self._space.viewer)
        for k, piece in enumerate(self._pieces):
            shown = layer == k
            if shown.all():
                piece.set_data_3d(*points.T)
                continue
            shown[:-1] |= shown[1:] & (layer[:-1] > k)  # close the gap to a piece that is drawn above this one
            shown[1:] |= (layer == k)[:-1] & (layer[1:] > k)
            piece.set_data_3d(*np.where(shown[:, None], points, np.nan).T)

    def remove(self) -> None:
        for piece in self._pieces:
            piece.remove()


class Space:
    """Axes in three dimensions: a box with a floor, the shapes of a body, and curves.

    Args:
        figure: where the axes go.
        bounds: left, bottom, width, height as shares of the figure.
        picture: a picture with three limits.
    """

    def __init__(self, figure: Any, bounds: tuple[float, float, float, float], picture: Picture) -> None:
        self._polygons = importlib.import_module("mpl_toolkits.mplot3d.art3d").Poly3DCollection
        limits = picture.limits
        with importlib.import_module("matplotlib").rc_context({"grid.color": "#d4d7dc", "grid.linewidth": 0.6}):
            self.axes = figure.add_axes(bounds, projection="3d", computed_zorder=False)
        self.axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
        self.axes.set_box_aspect([high - low for low, high in limits], zoom=1.1)
        self.axes.view_init(*picture.view)
        for name, axis, pane in zip(
            "xyz", (self.axes.xaxis, self.axes.yaxis, self.axes.zaxis), ("#fafbfc", "#f6f7f9", "#e9ecf0")
        ):
            axis.set_pane_color(pane)
            axis.set_major_locator(importlib.import_module("matplotlib.ticker").MaxNLocator(4, prune="both"))
            axis.line.set_color("#9aa0a8")
            axis.set_label_text(f"{name} (m)", size=9, color="#555555")
            axis.labelpad = -6
            axis.set_tick_params(labelsize=8, labelcolor="#777777", color="#9aa0a8", pad=-2)
        self.floor = limits[2][0]
        self.balls: list[Ball] = []
        self.viewer = eye(self.axes.get_proj())
        self._drawn_from: Array | None = None
        self._surfaces: list[Any] = []
        self._curves: list[Curve] = []
        self._lines: list[Curve] = []
        self._faces: list[Any] = []
        self._shadow = self._polygon([np.zeros((3, 3))], _SHADOW, 0.45, 0.1)

    def _polygon(self, vertices: Any, color: Any, alpha: float | None, zorder: float, **style: Any) -> Any:
        style = {"linewidths": 0, "edgecolors": "none", **style}
        collection = self._polygons(vertices, facecolors=color, alpha=alpha, zorder=zorder, **style)
        return self.axes.add_collection3d(collection)

    def curve(self, rank: str, **style: Any) -> Curve:
        """An empty curve; ``rank`` is one of :data:`RANKS`, ``style`` as in ``Axes.plot``."""
        self._curves.append(Curve(self, RANKS[rank], style))
        return self._curves[-1]

    def drop(self, points: Array) -> Array:
        """``points`` (n, 3) on the floor."""
        return np.column_stack([points[:, :2], np.full(len(points), self.floor)])

    def show(self, shapes: Sequence[Shape]) -> None:
        """Show these shapes and no others, with their shadows."""
        self.viewer = eye(self.axes.get_proj())
        self._stand([shape for shape in shapes if isinstance(shape, Ball)])
        lines = [shape for shape in shapes if isinstance(shape, Line)]
        self._fill([shape for shape in shapes if isinstance(shape, Face)], lines)
        while len(self._lines) > len(lines):
            self._lines.pop().remove()
        while len(self._lines) < len(lines):
            self._lines.append(Curve(self, RANKS["body"], {"solid_capstyle": "round"}))
        for curve, line in zip(self._lines, lines):
            curve.set(line.points, color=line.color, linewidth=line.width)
        shadows = [shape.points for shape in shapes if isinstance(shape, Face)]
        shadows += [disc(ball.center, ball.radius, 49) for ball in self.balls]
        self._shadow.set_verts([self.drop(points) for points in shadows])

    def _stand(self, balls: list[Ball]) -> None:
        """Draw ``balls`` where they or the viewer moved."""
        balls.sort(key=lambda ball: -float(np.linalg.norm(ball.center - self.viewer)))
        same = len(balls) == len(self.balls) and all(_same(a, b) for a, b in zip(balls, self.balls))
        if same and self._drawn_from is not None and np.array_equal(self.viewer, self._drawn_from):
            return
        self.balls, self._drawn_from = balls, self.viewer
        for artist in self._surfaces:
            artist.remove()
        self._surfaces = []
        to_rgb = importlib.import_module("matplotlib.colors").to_rgb
        image_of = importlib.import_module("matplotlib.image").AxesImage
        projection = self.axes.get_proj()
        for k, ball in enumerate(balls):
            pixels, extent = portrait(ball, projection, np.array(to_rgb(ball.color)))
            image = image_of(self.axes, extent=extent, origin="lower", zorder=_LAYER * (k + 1) - 1)
            image.set(data=pixels, interpolation="bilinear")
            self._surfaces.append(self.axes.add_artist(image))
        for curve in self._curves:
            curve.refresh()

    def _fill(self, faces: list[Face], lines: list[Line]) -> None:
        """Draw ``faces`` from far to near; below the lines if those lie on the viewer's side of them."""
        while len(self._faces) > len(faces):
            self._faces.pop().remove()
        while len(self._faces) < len(faces):
            self._faces.append(self._polygon([np.zeros((3, 3))], "black", None, 0.0))
        if not faces:
            return
        to_rgba = importlib.import_module("matplotlib.colors").to_rgba
        middles = np.array([face.points.mean(axis=0) for face in faces])
        behind = np.linalg.norm(middles - self.viewer, axis=1).argsort()[::-1].argsort()
        layer = layers(middles, self.balls, self.viewer)
        normals = np.array([np.cross(*(face.points[1:3] - face.points[0])) for face in faces])
        frame = np.concatenate([line.points for line in lines]).mean(axis=0) if lines else self.viewer
        above = ((frame - middles) * normals).sum(axis=1) * ((self.viewer - middles) * normals).sum(axis=1) < 0
        ranks = RANKS["body"] + np.where(above, 0.1, -0.1 - 0.9) + 0.9 * behind / len(faces)
        for face, artist, k, rank in zip(faces, self._faces, layer, ranks):
            artist.set_verts([face.points])
            # Colours with their own transparency: an alpha of the artist is applied anew at every change of colour.
            artist.set(facecolor=to_rgba(face.color, face.alpha), edgecolor=to_rgba(face.color), linewidth=0.8)
            artist.set_zorder(_LAYER * k + rank)


def _same(a: Ball, b: Ball) -> bool:
    look = (a.radius, a.color, a.alpha) == (b.radius, b.color, b.alpha)
    return look and np.array_equal(a.center, b.center)
