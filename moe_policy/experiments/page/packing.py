"""Arrays for JavaScript: one block of bytes in base64, and where each array lies in it."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.experiments.page.rounding import whole

#: Bytes at whose multiples arrays begin, as JavaScript's views of a buffer need.
ALIGNMENT = 8

#: An array as JavaScript finds it: type, first byte, number of values, and where its units are, if it has any.
Place = dict[str, Any]


class Packing:
    """Collects arrays; :meth:`place` adds one, :meth:`text` is the block of all.

    Args:
        rounded: whether weights have 8 bits.
    """

    def __init__(self, rounded: bool = False) -> None:
        self.rounded = rounded
        self._parts: list[bytes] = []
        self._size = 0

    def place(self, values: ArrayLike, kind: str = "float32") -> Place:
        """Where ``values``, as numbers of the type ``kind``, lie in the block.

        Single precision is stored as half precision where that is exact.
        """
        array = np.ascontiguousarray(values, dtype=kind).ravel()
        if array.dtype == np.float32 and _fits_half(array):
            array = array.astype(np.float16)
        begin = self._size
        content = array.tobytes()
        content += bytes(-len(content) % ALIGNMENT)
        self._parts.append(content)
        self._size += len(content)
        return {"type": array.dtype.name, "at": begin, "size": array.size}

    def weight(self, weight: NDArray[np.float32]) -> Place:
        """Where a ``weight`` (outputs, inputs) lies; :attr:`rounded`, as whole numbers and the unit of each row."""
        if not self.rounded:
            return self.place(weight)
        numbers, units = whole(weight)
        return {**self.place(numbers, "int8"), "units": self.place(units)}

    def text(self) -> str:
        """The block of all arrays in base64."""
        return base64.b64encode(b"".join(self._parts)).decode()


def _fits_half(array: NDArray[np.float32]) -> bool:
    with np.errstate(over="ignore"):
        return bool((array.astype(np.float16) == array).all())
