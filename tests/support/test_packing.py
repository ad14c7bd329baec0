from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ocp_envs.support.archives import DamagedFileError
from ocp_envs.support.packing import pack, unpack

SHAPES = arrays.array_shapes(min_dims=3, max_dims=3, min_side=0, max_side=6)
WHOLE = st.sampled_from([np.int8, np.uint8, np.int16, np.int32, np.uint32, np.int64])


@given(WHOLE.flatmap(lambda kind: arrays.arrays(kind, SHAPES)))
def test_whole_numbers_come_back_as_they_were(numbers):
    found = unpack(pack(numbers))
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, numbers, strict=False)
    assert found.shape == numbers.shape


def test_smooth_series_take_few_bytes():
    numbers = (np.arange(30)[:, None] ** 2 * np.array([3, -5]))[None].repeat(100, axis=0)
    assert len(pack(numbers)) < numbers.size / 20


@pytest.mark.parametrize("numbers", [np.zeros((2, 3, 4)), np.zeros((2, 3), int), np.zeros((1, 1, 1), np.uint64)])
def test_other_arrays_are_refused(numbers):
    with pytest.raises(ValueError, match=r"expected whole numbers \(B, N, c\)"):
        pack(numbers)


@pytest.fixture(scope="module")
def content():
    return pack(np.random.default_rng(0).integers(-300, 300, (4, 5, 2)))


def test_any_flipped_bit_is_found(content):
    whole = unpack(content)
    for at in range(8 * len(content)):
        damaged = bytearray(content)
        damaged[at // 8] ^= 1 << at % 8
        try:
            found = unpack(bytes(damaged))
        except DamagedFileError:
            continue
        np.testing.assert_array_equal(found, whole)  # a bit of zlib's header that changes nothing


def test_parts_of_the_content_and_additions_to_it_are_refused(content):
    for damaged in (*(content[:size] for size in range(len(content))), content + b"\0", content[1:], content * 2):
        with pytest.raises(DamagedFileError, match="packed numbers are damaged"):
            unpack(damaged)
