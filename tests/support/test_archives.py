"""Archives of arrays with damage anywhere."""

import tracemalloc
import zipfile
from io import BytesIO

import numpy as np
import pytest

from ocp_envs.support.archives import DamagedFileError, check_archive, read_arrays, write_arrays

ARRAYS = {"p": np.arange(40.0).reshape(20, 2), "fingerprint": np.array("abc"), "empty": np.empty((0, 3), np.int8)}


@pytest.fixture
def archive(tmp_path):
    write_arrays(tmp_path / "a.npz", ARRAYS)
    return tmp_path / "a.npz"


def test_what_is_written_is_read(archive):
    found = read_arrays(archive)
    assert found.keys() == ARRAYS.keys()
    for name, value in ARRAYS.items():
        np.testing.assert_array_equal(found[name], value)
        assert found[name].dtype == value.dtype
    check_archive(archive)


def test_a_flipped_bit_anywhere_changes_no_array(archive):
    """It is an error, changes nothing, or hides an array, which its reader will miss."""
    content, refused = archive.read_bytes(), 0
    tracemalloc.start()
    for place in range(len(content)):
        archive.write_bytes(content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :])
        try:
            found = read_arrays(archive)
            assert all(np.array_equal(value, ARRAYS[name]) for name, value in found.items())
        except DamagedFileError:
            refused += 1
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert refused > len(content) / 2
    assert peak < 2**24


@pytest.mark.parametrize("content", [None, b"", b"something else"])
@pytest.mark.parametrize("read", [read_arrays, check_archive])
def test_what_is_no_archive_is_an_error(tmp_path, content, read):
    if content is not None:
        (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"a\.npz is damaged, or no"):
        read(tmp_path / "a.npz")


def test_a_header_that_asks_for_terabytes_gets_nothing(tmp_path):
    header = BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**13,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as file:
        file.writestr("p.npy", header.getvalue())
    with pytest.raises(DamagedFileError):
        read_arrays(tmp_path / "a.npz")


def test_nothing_is_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", p=np.array([print], dtype=object))
    with pytest.raises(DamagedFileError, match="allow_pickle"):
        read_arrays(tmp_path / "a.npz")
