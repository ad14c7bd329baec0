"""Drawing in the plane: the shapes of :mod:`ocp_envs.picture` and curves on Matplotlib's axes."""

from __future__ import annotations

from collections.abc import Sequence

from ocp_envs.picture import Face, Line, Picture, Shape
from ocp_envs.render.style import Artist, Figure, matplotlib
from ocp_envs.support.arrays import Array

#: zorder of the curves; shapes lie above them.
RANKS = {"goal": 1.5, "plan": 1.7, "trail": 1.8}


class Plane:
    """Axes in the plane with shapes and curves; :class:`~ocp_envs.render.space.Space` has the same methods in space.

    ``figure`` gets the axes at ``bounds`` (left, bottom, width, height as fractions); ``picture`` has two limits.
    """

    def __init__(self, figure: Figure, bounds: tuple[float, float, float, float], picture: Picture) -> None:
        self.axes = figure.add_axes(bounds)
        self.axes.set(xlim=picture.limits[0], ylim=picture.limits[1])
        self.axes.set_aspect("equal")
        self.axes.set_axis_off()
        self._artists: list[tuple[type[Shape], Artist]] = []

    def curve(self, rank: str, **style: object) -> PlaneCurve:
        """A new curve without points, with a ``style`` as in ``Axes.plot``.

        ``rank``, a key of :data:`RANKS`, says what the curve shows and thus what covers what.
        """
        return PlaneCurve(self.axes.plot([], [], zorder=RANKS[rank], **style)[0])

    def show(self, shapes: Sequence[Shape]) -> None:
        """Show ``shapes`` in place of those shown before; artists are moved where the kinds of shapes agree."""
        if [type(shape) for shape in shapes] != [kind for kind, _ in self._artists]:
            for _, artist in self._artists:
                artist.remove()
            self._artists = [(type(shape), self._add(shape)) for shape in shapes]
        else:
            for shape, (_, artist) in zip(shapes, self._artists):
                _move(shape, artist)

    def _add(self, shape: Shape) -> Artist:
        if isinstance(shape, Line):
            style = {"color": shape.color, "lw": shape.width, "solid_capstyle": "round", "zorder": 2}
            return self.axes.plot(*shape.points.T, **style)[0]
        patches = matplotlib("patches")
        style = {"fc": shape.color, "alpha": shape.alpha, "zorder": 2.5}
        if isinstance(shape, Face):
            return self.axes.add_patch(patches.Polygon(shape.points, **style))
        return self.axes.add_patch(patches.Circle(shape.center, shape.radius, **style))


class PlaneCurve:
    """A curve in the plane, drawn by ``artist``, a ``Line2D`` of Matplotlib."""

    def __init__(self, artist: Artist) -> None:
        self._artist = artist

    def set(self, points: Array) -> None:
        """Make the curve pass through ``points`` (n, 2), metres."""
        self._artist.set_data(*points.T)


def _move(shape: Shape, artist: Artist) -> None:
    if isinstance(shape, Line):
        artist.set_data(*shape.points.T)
        artist.set(color=shape.color, linewidth=shape.width)
    elif isinstance(shape, Face):
        artist.set(xy=shape.points, facecolor=shape.color, alpha=shape.alpha)
    else:
        artist.set(center=shape.center, radius=shape.radius, facecolor=shape.color, alpha=shape.alpha)
