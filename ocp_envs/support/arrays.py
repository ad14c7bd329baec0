"""Array types, arrays that nobody can change, large arrays in files, and arrays as C sees them."""

from __future__ import annotations

import ctypes
import math
import tempfile
from collections.abc import Sequence
from typing import TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)
#: Larger arrays of :func:`scratch`, in bytes, are in a file. ``TMPDIR`` chooses its folder.
LARGE = 256 * 2**20


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


def scratch(shape: tuple[int, ...], dtype: type[Value]) -> NDArray[Value]:
    """An array of ``shape`` and ``dtype`` with undefined values, in a file where it exceeds :data:`LARGE`.

    Training data, which are read at random, need not fit in memory: the operating system keeps the pages in use and
    writes the others back. The file is deleted with the last reference to the array.

    Raises:
        OSError: not enough space on the disk.
    """
    if math.prod(shape) * np.dtype(dtype).itemsize <= LARGE:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(prefix="ocp_envs-") as file:  # has no name, so nothing is left behind by a crash
        return np.asarray(np.memmap(file, dtype=dtype, mode="w+", shape=shape))


def address(array: NDArray[np.generic]) -> int:
    """Where the values of ``array`` are, which must be contiguous and live as long as the address is used."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # type: ignore[arg-type]  # four times as fast
    except (TypeError, ValueError):  # read-only, or empty
        assert array.flags.c_contiguous
        return int(array.ctypes.data)


def pointers(arrays: Sequence[NDArray[np.generic]]) -> ctypes.Array[ctypes.c_void_p]:
    """The :func:`address` of each of ``arrays``, as an array of C."""
    return (ctypes.c_void_p * max(len(arrays), 1))(*map(address, arrays))
