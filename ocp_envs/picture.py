"""What a problem looks like, as data: a few shapes in world coordinates that :mod:`ocp_envs.rendering` draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Line:
    """A polyline through ``points`` (n, 2) or (n, 3), metres; ``width`` in points."""

    points: Array
    width: float = 2.0
    color: str = "black"


@dataclass(frozen=True, eq=False)
class Ball:
    """A disc (centre (2,)) or sphere (centre (3,)) of ``radius`` metres."""

    center: Array
    radius: float
    color: str = "black"
    alpha: float = 1.0


Shape = Line | Ball


@dataclass(frozen=True, eq=False)
class Picture:
    """How to draw a problem.

    Args:
        limits: ((x_min, x_max), (y_min, y_max)) or three such pairs, metres.
        body: (state (nx,), context (nc,)) → shapes of the moving body and of what stands around it.
        path: states (N, nx) → positions (N, 2 or 3) that trace a trajectory.
    """

    limits: tuple[tuple[float, float], ...]
    body: Callable[[Array, Array], Sequence[Shape]]
    path: Callable[[Array], Array]
