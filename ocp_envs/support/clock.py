"""Durations in seconds as numbers of time steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocp_envs.support.arrays import Ints

#: A duration that exceeds a multiple of the step by at most this fraction of it counts as that multiple.
TOLERANCE = 1e-6


def count_steps(duration: ArrayLike, step: float) -> Ints:
    """⌈duration/step⌉, the number of time steps of length ``step`` that cover ``duration``, up to :data:`TOLERANCE`.

    Both are in seconds; the result has the shape of ``duration``. The tolerance absorbs rounding, in 0.3/0.1 =
    2.9999999999999996 as in 2.1/0.3 = 7.000000000000001, and that of an optimised duration.
    """
    return np.asarray(np.ceil(np.asarray(duration) / step - TOLERANCE), dtype=np.int64)
