"""Arrays in NumPy's ``.npz`` archives, whose checksums are compared before anything of them is used."""

from __future__ import annotations

import os
import zipfile
from io import BytesIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ocp_envs.support.files import replacing

#: No content is compressed to less than one part in so many (https://zlib.net/zlib_tech.html).
_LARGEST_RATIO = 1100


class DamagedFileError(ValueError):
    """A file is damaged, or is not what it should be."""


def write_arrays(path: str | os.PathLike[str], arrays: dict[str, ArrayLike]) -> None:
    """Write ``arrays``, by name, to the compressed archive ``path``, in one step."""
    with replacing(path) as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_arrays(path: str | os.PathLike[str]) -> dict[str, NDArray[np.generic]]:
    """The arrays of the archive ``path`` by name; nothing is unpickled.

    Raises:
        DamagedFileError: a damaged file, or no archive of arrays.
    """
    try:
        size = os.path.getsize(path)
        with zipfile.ZipFile(path) as archive:
            for each in archive.infolist():  # before anything of that size is allocated
                if each.file_size > _LARGEST_RATIO * (each.compress_size + 1) or each.compress_size > size:
                    raise ValueError(f"{each.filename} has {each.file_size} bytes in {each.compress_size}")
            # Read whole, and so with its checksum compared, before NumPy allocates what a header asks for.
            contents = {name: archive.read(name) for name in archive.namelist()}
        return {
            name.removesuffix(".npy"): np.lib.format.read_array(BytesIO(content), allow_pickle=False)
            for name, content in contents.items()
        }
    except Exception as error:  # what a damaged file makes the readers raise is their affair
        raise DamagedFileError(f"{path} is damaged, or no archive of arrays ({error})") from error


def check_archive(path: str | os.PathLike[str]) -> None:
    """Compare the checksums of everything in the zip file ``path``.

    Raises:
        DamagedFileError: one differs, or this is no zip file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
    except Exception as error:  # as above
        raise DamagedFileError(f"{path} is damaged, or no zip file ({error})") from error
    if damaged is not None:
        raise DamagedFileError(f"{path} is damaged: the checksum of {damaged} differs")
