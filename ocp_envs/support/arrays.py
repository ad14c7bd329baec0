"""Array types, and arrays that nobody can change."""

from __future__ import annotations

from typing import TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)


def read_only(array: Array) -> Array:
    """A read-only view of ``array``."""
    view = array.view()
    view.flags.writeable = False
    return view


@overload
def frozen_array(values: ArrayLike) -> Array: ...
@overload
def frozen_array(values: ArrayLike, dtype: type[Value]) -> NDArray[Value]: ...
def frozen_array(values: ArrayLike, dtype: type[np.generic] = np.float64) -> NDArray[np.generic]:
    """A read-only copy of ``values`` with the type ``dtype``."""
    array = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array
