"""Large arrays in files that are deleted with the last reference to them.

Training data, which are read at random, need not fit in memory: the operating system keeps the pages in use and writes
the others back. Small arrays stay in memory.
"""

from __future__ import annotations

import math
import tempfile
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value", bound=np.generic)

#: Larger arrays, in bytes, are in a file. Its folder is that of :mod:`tempfile`, so ``TMPDIR`` chooses the disk.
LARGE = 256 * 2**20


def empty(shape: tuple[int, ...], dtype: type[Value]) -> NDArray[Value]:
    """An array of ``shape`` and ``dtype`` with undefined values, in a file where it exceeds :data:`LARGE`.

    Raises:
        OSError: not enough space on the disk.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size <= LARGE:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(prefix="ocp_envs-") as file:  # has no name, so nothing is left behind by a crash
        return np.asarray(np.memmap(file, dtype=dtype, mode="w+", shape=shape))
