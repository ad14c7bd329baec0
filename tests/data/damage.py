"""Damage to the files of a database: what disks, interrupted copies and editors do to them."""

from __future__ import annotations

import json
import tracemalloc
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import Crc32cCodec, ZstdCodec

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError, layout
from ocp_envs.problem import OptimalControlProblem

#: A damaged file: its new content, or ``None`` where it is removed.
Damaged = bytes | None
#: More memory, in bytes, than anything about a small database needs.
MUCH = 64 * 2**20

TEXTS = (b"", b"{", b"null", b"[]", b"{}", b"\xff\xfe{", b"[" * 200_000, b'{"a": 1' + b"0" * 5000 + b"}", b"mine\n")


def texts(content: bytes) -> Iterator[Damaged]:
    """What may stand in a file instead of its text."""
    yield None
    yield from TEXTS
    for part in (1, len(content) // 3, len(content) // 2, len(content) - 2):
        yield content[:part]
        yield content[:part] + bytes(len(content) - part)


def flips(content: bytes, count: int = 6) -> Iterator[Damaged]:
    """Single bits that are flipped, at places spread over the file."""
    for place in np.linspace(0, len(content) - 1, count).astype(int):
        changed = bytearray(content)
        changed[place] ^= 1 << int(place) % 8
        yield bytes(changed)


def pieces(content: bytes) -> Iterator[Damaged]:
    """What may happen to a piece of an array."""
    yield from (None, b"", content[:-1], content[: len(content) // 2], content + b"\0", bytes(len(content)))
    yield from flips(content)


SHAPES = (
    lambda shape: [],
    lambda shape: None,
    lambda shape: "x",
    lambda shape: [*shape, 1],
    lambda shape: [shape[0] + 1, *shape[1:]],
    lambda shape: [shape[0] - 1, *shape[1:]],
    lambda shape: [*shape[:-1], shape[-1] + 1],
    lambda shape: [-1, *shape[1:]],
    lambda shape: [0, *shape[1:]],
    lambda shape: [2.5, *shape[1:]],
    lambda shape: [10**12, *shape[1:]],
    lambda shape: [10**400, *shape[1:]],
)
TYPES = (
    "float32",
    "float64",
    "int8",
    "int16",
    "int32",
    "int64",
    "uint8",
    "bool",
    "string",
    "complex128",
    "r8",
    None,
    7,
)
FILLS = (0, 1, "NaN", "Infinity", "x", None, 10**400, [], True)
CODECS = (
    lambda codecs: [],
    lambda codecs: codecs[:-1],
    lambda codecs: codecs[1:],
    lambda codecs: codecs[::-1],
    lambda codecs: [*codecs, codecs[-1]],
    lambda codecs: [{"name": "nothing"}, *codecs],
    lambda codecs: [codecs[0], {"name": "gzip", "configuration": {"level": 1}}, *codecs[2:]],
    lambda codecs: [{"name": "bytes", "configuration": {"endian": "big"}}, *codecs[1:]],
    lambda codecs: [{"name": "transpose", "configuration": {"order": [0]}}, *codecs],
    lambda codecs: None,
    lambda codecs: "zstd",
)


def metadata(content: bytes) -> Iterator[Damaged]:
    """What an array's description may say instead: each key removed, or with another value."""
    record = json.loads(content)
    for key in record:
        yield json.dumps({name: value for name, value in record.items() if name != key}).encode()
    for values in _other_values(record):
        yield json.dumps(record | values).encode()


def _other_values(record: dict[str, Any]) -> Iterator[dict[str, object]]:
    for key in record:
        yield from ({key: value} for value in (None, 7, "x", [], {}, 10**400))
    grid, shape = record["chunk_grid"], record["chunk_grid"]["configuration"]["chunk_shape"]
    for change in SHAPES:
        yield {"shape": change(record["shape"])}
        yield {"chunk_grid": {**grid, "configuration": {"chunk_shape": change(shape)}}}
    yield from ({"data_type": kind} for kind in TYPES)
    yield from ({"fill_value": fill} for fill in FILLS)
    yield from ({"codecs": codec(record["codecs"])} for codec in CODECS)
    for name in ("default", "v2", "other"):
        for separator in (".", "x"):
            yield {"chunk_key_encoding": {"name": name, "configuration": {"separator": separator}}}
    yield from ({"zarr_format": version, "node_type": node} for version, node in ((2, "array"), (3, "group")))
    yield {"storage_transformers": [{"name": "nothing"}]}
    yield {"dimension_names": ["a"]}


def attributes(content: bytes) -> Iterator[Damaged]:
    """What the attributes of a database may say instead."""
    record = json.loads(content)
    for key, old in record["attributes"].items():
        yield json.dumps(record | {"attributes": {k: v for k, v in record["attributes"].items() if k != key}}).encode()
        for value in (None, 7, 0, -1, 10**12, 10**400, "x", [], {}, {"seed": 4}, not old):
            yield json.dumps(record | {"attributes": record["attributes"] | {key: value}}).encode()


@contextmanager
def damaged(file: Path, content: Damaged) -> Iterator[None]:
    """The ``file`` with another ``content`` for the duration of the block."""
    before = file.read_bytes()
    try:
        if content is None:
            file.unlink()
        else:
            file.write_bytes(content)
        yield
    finally:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(before)


def everything(path: Path, problem: OptimalControlProblem) -> tuple[object, ...]:
    """What tells a database from any other."""
    database = Database.open(path, problem)
    return database.digest(), database.key, database.totals(), database.chunk


def outcome(read: Callable[[], object], expected: object, error: type[Exception] = DatabaseError) -> str:
    """How reading ends: ``same`` or refused, ``changed`` without a word, a foreign error, or much memory asked for."""
    tracemalloc.start()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = "same" if read() == expected else "changed"
    except error:
        found = "refused"
    except Exception as foreign:
        found = f"foreign: {type(foreign).__name__}"
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return found if peak < MUCH else f"much memory, {found}"


def tally(files: list[Path], kind: Callable[[bytes], Iterator[Damaged]], read: Callable[[], object]) -> Counter[str]:
    """Outcomes of reading with each of the ``files`` damaged in each way of that ``kind``."""
    expected, found = read(), Counter[str]()
    for file in files:
        for content in kind(file.read_bytes()):
            with damaged(file, content):
                found[outcome(read, expected)] += 1
    return found


def write_first_version(path: Path, database: Database) -> None:
    """Write ``database`` to ``path`` the way the first version of the format did."""
    problem, chunk = database.problem, database.chunk
    group = zarr.open_group(path, mode="w", zarr_format=3)
    description = {"format": "ocp-moe database", "version": 1, "problem": problem.id}
    group.attrs.update({**description, "fingerprint": problem.fingerprint, "modes": list(problem.modes.names)})
    group.attrs.update({"chunk": chunk, "settings": database.settings})
    group.create_array("parameters", data=database.parameters)
    group.create_array("order", data=np.argsort(database._row_of_index))
    rows = database.stored(slice(0, len(database)))
    for name, column in layout(problem, chunk).items():
        group.create_array(
            name,
            shape=(len(database), *column.shape),
            chunks=(chunk, *(max(n, 1) for n in column.shape)),
            dtype=column.dtype,
            fill_value=column.fill,
            compressors=[ZstdCodec(level=1), Crc32cCodec()],
        )[:] = getattr(rows, name)
