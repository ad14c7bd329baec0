"""What a problem looks like, as data: a few shapes in world coordinates that :mod:`ocp_envs.render` draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ocp_envs.support.arrays import Array
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked


def _check_points(name: str, points: Array, least: int) -> None:
    shape = np.shape(points)
    if len(shape) != 2 or shape[0] < least or shape[1] not in (2, 3):
        raise ValueError(f"{name}: expected points (n, 2) or (n, 3) with n at least {least}, got {shape}")


@checked
@dataclass(frozen=True, eq=False)
class Line:
    """A polyline through ``points`` (n, 2) or (n, 3), metres; ``width`` in points, ``color`` as in Matplotlib."""

    points: Array
    width: float = 2.0
    color: str = "black"

    def __post_init__(self) -> None:
        _check_points("Line", self.points, 1)


@checked
@dataclass(frozen=True, eq=False)
class Face:
    """A filled plane polygon with the corners ``points`` (n, 2) or (n, 3), metres.

    ``color`` is one of Matplotlib's, ``alpha`` the opacity, 0 to 1.
    """

    points: Array
    color: str = "black"
    alpha: float = 1.0

    def __post_init__(self) -> None:
        _check_points("Face", self.points, 3)


@checked
@dataclass(frozen=True, eq=False)
class Ball:
    """A disc with ``center`` (2,) or a sphere with ``center`` (3,); ``radius`` and centre in metres.

    ``color`` is one of Matplotlib's, ``alpha`` the opacity, 0 to 1.
    """

    center: Array
    radius: float
    color: str = "black"
    alpha: float = 1.0

    def __post_init__(self) -> None:
        if np.shape(self.center) not in ((2,), (3,)) or not self.radius > 0:
            got = f"center of shape {np.shape(self.center)} and radius {self.radius}"
            raise ValueError(f"Ball: expected a center (2,) or (3,) and a positive radius, got {got}")


Shape = Line | Face | Ball


def corners(shape: Shape) -> Array:
    """Points (n, 2) or (n, 3) of ``shape``; of a ball, its centre."""
    return shape.center[None] if isinstance(shape, Ball) else shape.points


@checked
def disc(center: Array, radius: float, corners: int = 25, rotation: Array | None = None) -> Array:
    """A polygon that approximates a disc in space, (n, 3).

    Args:
        center: of the disc, (3,), metres.
        radius: metres.
        corners: n, at most 1000.
        rotation: (3, 3); its third column is the normal of the disc, upwards by default.

    Raises:
        TypeError, ValueError: arguments of other types or shapes.
    """
    check_whole("corners", corners, 3, 1000)
    turn = np.eye(3) if rotation is None else rotation
    if np.shape(center) != (3,) or np.shape(turn) != (3, 3):
        raise ValueError(f"expected center (3,) and rotation (3, 3), got {np.shape(center)} and {np.shape(turn)}")
    angle = np.linspace(0, 2 * np.pi, corners)
    flat = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(corners)], axis=1)
    return np.asarray(center + flat @ np.transpose(turn))


@checked
@dataclass(frozen=True, eq=False)
class Picture:
    """How to draw a problem, in the plane or in space.

    Args:
        limits: ((x_min, x_max), (y_min, y_max)) for a problem in the plane, three such pairs in space, metres.
        body: (state (nx,), context (nc,)) → shapes of the moving body and of what stands around it.
        path: states (N, nx) → positions (N, 2 or 3) that trace a trajectory.
        view: elevation and azimuth of the camera, degrees; in space only.
        caption: a remark below the title, such as the scale of the body.

    Raises:
        ValueError: not two or three intervals, or an interval that is empty or not finite.
    """

    limits: tuple[tuple[float, float], ...]
    body: Callable[[Array, Array], Sequence[Shape]]
    path: Callable[[Array], Array]
    view: tuple[float, float] = (20.0, -55.0)
    caption: str = ""

    def __post_init__(self) -> None:
        limits = (
            np.asarray(self.limits, dtype=np.float64) if {len(pair) for pair in self.limits} == {2} else np.empty(0)
        )
        if limits.shape not in ((2, 2), (3, 2)) or not np.isfinite(limits).all() or (np.diff(limits) <= 0).any():
            raise ValueError(
                f"Picture: expected limits ((x_min, x_max), (y_min, y_max)) in the plane or three such pairs in space, "
                f"each with min < max, got {self.limits}"
            )

    @property
    def dimensions(self) -> int:
        """2 in the plane, 3 in space."""
        return len(self.limits)

    def trace(self, states: Array) -> Array:
        """``path`` of ``states`` (N, nx), checked.

        Raises:
            ValueError: ``path`` returns another shape than (N, dimensions).
        """
        points = np.asarray(self.path(states), dtype=np.float64)
        if points.shape != (len(states), self.dimensions):
            expected = (len(states), self.dimensions)
            raise ValueError(
                f"Picture: path has to return {expected}, as there are {expected[1]} limits, got {points.shape}"
            )
        return points

    def shapes(self, state: Array, context: Array) -> list[Shape]:
        """``body`` of ``state`` (nx,) and ``context`` (nc,), checked.

        Raises:
            ValueError: ``body`` returns a shape in the plane for a picture in space, or the other way round.
        """
        shapes = list(self.body(state, context))
        for shape in shapes:
            if corners(shape).shape[1] != self.dimensions:
                raise ValueError(
                    f"Picture: body has to return shapes of {self.dimensions} coordinates, as there are "
                    f"{self.dimensions} limits, got a {type(shape).__name__} of {corners(shape).shape[1]}"
                )
        return shapes
