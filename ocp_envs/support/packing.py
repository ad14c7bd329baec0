"""Whole numbers of smooth series in few bytes, without any loss.

Each series n_0, n_1, … is replaced by its second differences, of which most are small where it is smooth:

    d_k = n_k - 2 n_{k-1} + n_{k-2},   n_{-1} = n_{-2} = 0

Signs go to the lowest bit (zigzag: 0, -1, 1, -2, … become 0, 1, 2, 3, …), and the least significant bytes of all
numbers come first, then the next ones, so that the bytes that are nearly always zero are together. zlib compresses the
result, with the shape before it, and adds a checksum. All arithmetic is modulo 2^64 and hence exact for every number.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.archives import DamagedFileError
from ocp_envs.support.arrays import Ints

#: Bytes of each number, and the shape of the array.
_HEADER = struct.Struct("<4Q")
_ORDER = 2


def pack(numbers: NDArray[np.integer]) -> bytes:
    """The whole ``numbers`` (B, N, c) in few bytes: B times c series of N numbers.

    Raises:
        ValueError: no whole numbers that int64 can hold, or another number of axes.
    """
    if numbers.ndim != 3 or numbers.dtype.kind not in "iu" or not np.can_cast(numbers.dtype, np.int64):
        raise ValueError(f"numbers: expected whole numbers (B, N, c) in int64, got {numbers.dtype} {numbers.shape}")
    differences = numbers.astype(np.int64).transpose(2, 0, 1).view(np.uint64)
    for _ in range(_ORDER):
        differences = np.diff(differences, axis=2, prepend=np.uint64(0))
    signed = differences.view(np.int64)
    zigzag = np.ascontiguousarray((signed << 1) ^ (signed >> 63)).view(np.uint64).ravel()
    width = max(1, (int(zigzag.max(initial=0)).bit_length() + 7) // 8)
    planes = zigzag.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T
    return zlib.compress(_HEADER.pack(width, *numbers.shape) + planes.tobytes(), 9)


def unpack(content: bytes) -> Ints:
    """The numbers of which :func:`pack` made ``content``.

    Raises:
        DamagedFileError: the content is damaged, or is not what ``pack`` made.
    """
    try:
        stream = zlib.decompressobj()
        width, *shape = _HEADER.unpack(stream.decompress(content, _HEADER.size))
        size = math.prod(shape)
        # One byte more than expected: a stream that is too long shows, and takes no more memory than it should.
        planes = stream.decompress(stream.unconsumed_tail, size * width + 1)
        if not 1 <= width <= 8 or len(planes) != size * width or not stream.eof or stream.unused_data:
            raise ValueError(f"{len(planes)} bytes for {size} numbers of {width}")
    except (ValueError, OverflowError, struct.error, zlib.error) as error:
        raise DamagedFileError(f"packed numbers are damaged ({error})") from error
    numbers = np.zeros((size, 8), np.uint8)
    numbers[:, :width] = np.frombuffer(planes, np.uint8).reshape(width, size).T
    zigzag = numbers.view("<u8").astype(np.uint64).reshape(shape[2], shape[0], shape[1])
    series = (zigzag >> np.uint64(1)) ^ -(zigzag & np.uint64(1))
    for _ in range(_ORDER):
        series = np.cumsum(series, axis=2, dtype=np.uint64)
    return np.ascontiguousarray(series.transpose(1, 2, 0)).view(np.int64)
