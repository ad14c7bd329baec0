"""Large arrays in files that vanish with the last reference to them.

What is read at random by a training need not fit in memory: the operating system keeps the pages that are in use and
writes the others back. Small arrays stay in memory.
"""

from __future__ import annotations

import math
import tempfile
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

#: Arrays of more bytes lie in a file; its folder is that of :mod:`tempfile`, so ``TMPDIR`` chooses the disk.
LARGE = 256 * 2**20


def empty(shape: tuple[int, ...], dtype: DTypeLike = np.float64, large: int | None = None) -> NDArray[Any]:
    """An array whose values are still undefined, in a file where it takes more than ``large`` (:data:`LARGE`) bytes.

    Raises:
        OSError: no room on the disk.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size <= (LARGE if large is None else large):
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(prefix="ocp_envs-") as file:  # has no name, so nothing is left behind by a crash
        return np.asarray(np.memmap(file, dtype=dtype, mode="w+", shape=shape))
