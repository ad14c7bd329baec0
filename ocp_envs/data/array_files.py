"""The arrays of a database on disk: described before they are read, and written piece by piece."""

from __future__ import annotations

import itertools
import json
from collections.abc import Collection, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.core.metadata.v3 import ArrayV3Metadata

from ocp_envs.data.layout import CURE, Column, DatabaseError
from ocp_envs.support.files import sync_file, sync_folder


def _create(store: Path | dict[str, object], column: Column, size: int) -> Any:
    return zarr.create_array(
        store,
        shape=(size, *column.shape),
        chunks=(column.piece or 1, *(max(n, 1) for n in column.shape)),
        dtype=column.dtype,
        fill_value=column.fill,
        compressors=[ZstdCodec(level=1), Crc32cCodec()] if column.piece else [ZstdCodec(level=0)],
    )


@lru_cache(maxsize=256)
def _declared(column: Column, size: int) -> dict[str, Any]:
    """The description that Zarr writes of a ``column`` of ``size`` rows."""
    return dict(_create({}, column, size).metadata.to_dict())


class ArrayFiles:
    """The arrays ``columns`` in the folder ``path``, of one of the numbers of rows ``sizes``.

    Raises:
        DatabaseError: an array that is missing, or is described otherwise than it was declared. Nothing is allocated
            before this is known.
    """

    def __init__(self, path: Path, columns: Mapping[str, Column], sizes: Collection[int]) -> None:
        self.path, self._columns = path, columns
        for name, column in columns.items():
            _check(path / name, column, sizes)
        # Pieces of nothing but initial values are written too, so that a missing one shows.
        always = {"write_empty_chunks": True}
        self._arrays = {name: zarr.open_array(path / name, mode="r+").with_config(always) for name in columns}

    @classmethod
    def create(cls, path: Path, columns: Mapping[str, Column], size: int) -> ArrayFiles:
        """The arrays ``columns`` in the folder ``path``, of ``size`` rows with initial values; they must not exist."""
        for name, column in columns.items():
            _create(path / name, column, size)
        return cls(path, columns, [size])

    def read(self, name: str, rows: slice) -> NDArray[Any]:
        """The ``rows`` of the array ``name``.

        Raises:
            DatabaseError: damaged files.
        """
        try:
            return np.asarray(self._arrays[name][rows])
        except Exception as error:  # what a damaged piece makes a codec raise is the codec's affair
            raise DatabaseError(f"{self.path / name} is damaged and cannot be read ({error}); {CURE}") from error

    def write(self, name: str, rows: slice, values: ArrayLike) -> None:
        """Write ``values`` to the ``rows`` of the array ``name``.

        They are on the disk when this returns. After a power failure a new piece is there or not; one that holds other
        rows too is there.

        Raises:
            DatabaseError: a damaged piece that holds other rows too.
        """
        pieces = self._pieces(name, rows)
        replaced = [file for file in pieces if file.exists()]
        try:
            self._arrays[name][rows] = values
        except OSError:
            raise
        except Exception as error:  # of a codec
            raise DatabaseError(f"{self.path / name} is damaged and cannot be added to ({error}); {CURE}") from error
        for file in pieces:
            sync_file(file)
        for file in replaced:
            sync_folder(file.parent)

    def resize(self, size: int) -> None:
        """Give all arrays ``size`` rows."""
        for name, array in self._arrays.items():
            array.resize((size, *self._columns[name].shape))
            sync_file(self.path / name / "zarr.json")

    def exist(self, name: str, rows: slice) -> bool:
        """Whether all pieces with ``rows`` of the array ``name`` are there."""
        return all(file.is_file() for file in self._pieces(name, rows))

    def _pieces(self, name: str, rows: slice) -> list[Path]:
        """The files of ``rows`` of the array ``name``."""
        array = self._arrays[name]
        if 0 in array.shape or rows.start >= rows.stop:
            return []
        along_rows = range(rows.start // array.chunks[0], -(-rows.stop // array.chunks[0]))
        others = (range(-(-size // chunk)) for size, chunk in zip(array.shape[1:], array.chunks[1:]))
        return [self.path / name / "/".join(map(str, ("c", *at))) for at in itertools.product(along_rows, *others)]


def _check(folder: Path, column: Column, sizes: Collection[int]) -> None:
    """Raise where the array in ``folder`` is described otherwise than ``column`` with one of ``sizes`` rows."""
    found = _described(folder)
    wanted = [_declared(column, size) for size in sizes]
    if column.piece is None:
        pieces = found["chunk_grid"]["configuration"]["chunk_shape"]
        if len(pieces) == len(found["shape"]) and all(1 <= n <= max(m, 1) for n, m in zip(pieces, found["shape"])):
            wanted = [{**each, "chunk_grid": found["chunk_grid"]} for each in wanted]
    if found not in wanted:
        key = next(key for key in found | wanted[0] if found.get(key) != wanted[0].get(key))
        got, expected = found.get(key), wanted[0].get(key)
        raise DatabaseError(f"{folder} is damaged: got {key} {got!r:.200}, expected {expected!r}; {CURE}")


def _described(folder: Path) -> dict[str, Any]:
    """The description of the array in ``folder``, without anything that Zarr does not know."""
    try:
        content = json.loads((folder / "zarr.json").read_bytes())
        return dict(ArrayV3Metadata.from_dict(content).to_dict())
    except FileNotFoundError as error:
        raise DatabaseError(f"{folder.parent} is damaged: array {folder.name} is missing; {CURE}") from error
    except Exception as error:  # Zarr raises what its parser meets
        raise DatabaseError(f"{folder} is damaged: its description cannot be read ({error!s:.200}); {CURE}") from error
