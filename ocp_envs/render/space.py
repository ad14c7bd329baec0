"""Drawing in space: Matplotlib's axes in three dimensions, with a corrected drawing order.

Matplotlib sorts whole artists by depth and draws every line below every surface, which is wrong for a path that passes
round a sphere. Here spheres are drawn from far to near, and each part of a curve is drawn in the layer below the
farthest sphere that hides it (:mod:`ocp_envs.render.visibility`). Shadows fall straight down to the floor, so that a
still picture shows height and depth.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence

import numpy as np

from ocp_envs.picture import Ball, Face, Line, Picture, Shape, disc
from ocp_envs.render.style import GREY, Artist, Axes, Figure, Style, matplotlib
from ocp_envs.render.visibility import eye, layers, portrait
from ocp_envs.support.arrays import Array

_LAYER = 10.0  # difference in zorder between one sphere and the next
#: zorder within a layer.
RANKS = {"shadow": 0.5, "goal": 1.0, "plan": 2.0, "trail": 3.0, "body": 5.0}


class SpaceCurve:
    """A curve in ``space``, split into pieces that are each drawn in the layer below the farthest sphere hiding them.

    ``rank`` is its zorder within a layer; ``style`` is as in ``Axes.plot``.
    """

    def __init__(self, space: Space, rank: float, style: Style) -> None:
        self._space, self._rank, self._style = space, rank, style
        self._points = np.empty((0, 3))
        self._pieces: list[Artist] = []

    def set(self, points: Array, **style: object) -> None:
        """Make the curve pass through ``points`` (n, 3), metres, and change its ``style``."""
        self._points = points
        for piece in self._pieces:
            piece.set(**style)
        self._style.update(style)
        self.refresh()

    def refresh(self) -> None:
        """Assign the points to the layers of the present spheres and viewer."""
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
            shown[:-1] |= shown[1:] & (layer[:-1] > k)  # reach the first point of a piece drawn above this one
            shown[1:] |= (layer == k)[:-1] & (layer[1:] > k)
            piece.set_data_3d(*np.where(shown[:, None], points, np.nan).T)

    def remove(self) -> None:
        """Remove the curve from the axes."""
        for piece in self._pieces:
            piece.remove()


class Space:
    """Axes in three dimensions: a box with a floor, shapes and their shadows, and curves.

    ``figure`` gets the axes at ``bounds`` (left, bottom, width, height as fractions); ``picture`` has three limits.
    """

    def __init__(self, figure: Figure, bounds: tuple[float, float, float, float], picture: Picture) -> None:
        self._polygons = importlib.import_module("mpl_toolkits.mplot3d.art3d").Poly3DCollection
        self.axes = _axes(figure, bounds, picture)
        self.floor = picture.limits[2][0]
        self.balls: list[Ball] = []
        self.viewer = eye(self.axes.get_proj())
        self._drawn_from: Array | None = None
        self._surfaces: list[Artist] = []
        self._curves: list[SpaceCurve] = []
        self._lines: list[SpaceCurve] = []
        self._faces: list[Artist] = []
        self._shadow = self._polygon(GREY, 0.45, 0.1)

    def _polygon(self, color: str, alpha: float | None, zorder: float) -> Artist:
        """A collection of polygons without area, to be given vertices."""
        style = {"linewidths": 0, "edgecolors": "none", "facecolors": color, "alpha": alpha, "zorder": zorder}
        return self.axes.add_collection3d(self._polygons([np.zeros((3, 3))], **style))

    def curve(self, rank: str, **style: object) -> SpaceCurve:
        """A new curve without points, with a ``style`` as in ``Axes.plot``.

        ``rank``, a key of :data:`RANKS`, says what the curve shows and thus what covers what within a layer.
        """
        self._curves.append(SpaceCurve(self, RANKS[rank], style))
        return self._curves[-1]

    def drop(self, points: Array) -> Array:
        """``points`` (n, 3) projected onto the floor, (n, 3)."""
        return np.column_stack([points[:, :2], np.full(len(points), self.floor)])

    def show(self, shapes: Sequence[Shape]) -> None:
        """Show ``shapes`` with their shadows in place of those shown before."""
        self.viewer = eye(self.axes.get_proj())
        self._show_balls([shape for shape in shapes if isinstance(shape, Ball)])
        lines = [shape for shape in shapes if isinstance(shape, Line)]
        faces = [shape for shape in shapes if isinstance(shape, Face)]
        self._show_faces(faces, lines)
        while len(self._lines) > len(lines):
            self._lines.pop().remove()
        while len(self._lines) < len(lines):
            self._lines.append(SpaceCurve(self, RANKS["body"], {"solid_capstyle": "round"}))
        for curve, line in zip(self._lines, lines):
            curve.set(line.points, color=line.color, linewidth=line.width)
        shadows = [face.points for face in faces] + [disc(ball.center, ball.radius, 49) for ball in self.balls]
        self._shadow.set_verts([self.drop(points) for points in shadows])

    def _show_balls(self, balls: list[Ball]) -> None:
        """Draw ``balls`` from far to near, unless neither they nor the viewer moved."""
        balls.sort(key=lambda ball: -float(np.linalg.norm(ball.center - self.viewer)))
        same = len(balls) == len(self.balls) and all(_same(a, b) for a, b in zip(balls, self.balls))
        if same and self._drawn_from is not None and np.array_equal(self.viewer, self._drawn_from):
            return
        self.balls, self._drawn_from = balls, self.viewer
        for artist in self._surfaces:
            artist.remove()
        self._surfaces = [self._surface(ball, _LAYER * (k + 1) - 1) for k, ball in enumerate(balls)]
        for curve in self._curves:
            curve.refresh()

    def _surface(self, ball: Ball, zorder: float) -> Artist:
        color = np.array(matplotlib("colors").to_rgb(ball.color))
        pixels, extent = portrait(ball, self.axes.get_proj(), color)
        image = matplotlib("image").AxesImage(self.axes, extent=extent, origin="lower", zorder=zorder)
        image.set(data=pixels, interpolation="bilinear")
        return self.axes.add_artist(image)

    def _show_faces(self, faces: list[Face], lines: list[Line]) -> None:
        """Draw ``faces`` from far to near."""
        while len(self._faces) > len(faces):
            self._faces.pop().remove()
        while len(self._faces) < len(faces):
            self._faces.append(self._polygon("black", None, 0.0))
        if not faces:
            return
        to_rgba = matplotlib("colors").to_rgba
        for face, artist, zorder in zip(faces, self._faces, self._orders(faces, lines)):
            artist.set_verts([face.points])
            # The colours carry the transparency: Matplotlib reapplies an artist's alpha at every change of colour.
            artist.set(facecolor=to_rgba(face.color, face.alpha), edgecolor=to_rgba(face.color), linewidth=0.8)
            artist.set_zorder(zorder)

    def _orders(self, faces: list[Face], lines: list[Line]) -> Array:
        """zorder of each face: within its layer from far to near, below the lines on the viewer's side of the face."""
        middles = np.array([face.points.mean(axis=0) for face in faces])
        nearness = np.linalg.norm(middles - self.viewer, axis=1).argsort()[::-1].argsort()
        normals = np.array([np.cross(*(face.points[1:3] - face.points[0])) for face in faces])
        frame = np.concatenate([line.points for line in lines]).mean(axis=0) if lines else self.viewer
        above = ((frame - middles) * normals).sum(axis=1) * ((self.viewer - middles) * normals).sum(axis=1) < 0
        ranks = RANKS["body"] + np.where(above, 0.1, -0.1 - 0.9) + 0.9 * nearness / len(faces)
        return np.asarray(_LAYER * layers(middles, self.balls, self.viewer) + ranks)


def _axes(figure: Figure, bounds: tuple[float, float, float, float], picture: Picture) -> Axes:
    limits = picture.limits
    with importlib.import_module("matplotlib").rc_context({"grid.color": "#d4d7dc", "grid.linewidth": 0.6}):
        axes = figure.add_axes(bounds, projection="3d", computed_zorder=False)
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
    axes.set_box_aspect([high - low for low, high in limits], zoom=1.1)
    axes.view_init(*picture.view)
    for name, axis, pane in zip("xyz", (axes.xaxis, axes.yaxis, axes.zaxis), ("#fafbfc", "#f6f7f9", "#e9ecf0")):
        axis.set_pane_color(pane)
        axis.set_major_locator(matplotlib("ticker").MaxNLocator(4, prune="both"))
        axis.line.set_color("#9aa0a8")
        axis.set_label_text(f"{name} (m)", size=9, color="#555555")
        axis.labelpad = -6
        axis.set_tick_params(labelsize=8, labelcolor="#777777", color="#9aa0a8", pad=-2)
    return axes


def _same(a: Ball, b: Ball) -> bool:
    look = (a.radius, a.color, a.alpha) == (b.radius, b.color, b.alpha)
    return look and np.array_equal(a.center, b.center)
