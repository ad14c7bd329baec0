"""Array types, and arrays that nobody can change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def read_only(array: Array) -> Array:
    """A read-only view of ``array``."""
    view = array.view()
    view.flags.writeable = False
    return view


def frozen_array(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of ``values`` with the type ``dtype``."""
    array = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array
