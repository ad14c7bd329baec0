"""Files that are either complete or absent, also after a power failure."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A binary file that replaces ``path`` at the end of the block, in one step; its folder is created.

    A reader sees the old file or the new one, never a part of one. If the block fails, the old file stays. The content
    is on the disk before the name is, so that a power failure leaves one of the two as well.
    """
    target = Path(path)
    make_folder(target.parent)
    descriptor, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}-")
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)  # mkstemp makes files that only their owner can read
        os.replace(temporary, target)
    except BaseException:
        os.unlink(temporary)
        raise
    sync_folder(target.parent)


def rename_folder(folder: Path, path: Path) -> None:
    """Give ``folder`` the name ``path`` in one step, after all that is in it is on the disk."""
    for inner, _, names in os.walk(folder):
        for name in names:
            sync_file(Path(inner, name))
        sync_folder(Path(inner))
    os.replace(folder, path)
    sync_folder(path.parent)


def sync_file(path: Path) -> None:
    """Wait until the content of the file ``path`` is on the disk."""
    with open(path, "rb") as file:
        os.fsync(file.fileno())


def sync_folder(path: Path) -> None:
    """Wait until the names in the folder ``path`` are on the disk, where the system can do so."""
    with contextlib.suppress(OSError):  # Windows opens no folders, and not every file system can write them
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def make_folder(path: Path) -> None:
    """Make the folder ``path`` and those above it, where they are missing; their names are then on the disk."""
    if not path.is_dir():
        make_folder(path.parent)
        path.mkdir(exist_ok=True)
        sync_folder(path.parent)


def sync_everything() -> None:
    """Wait until all that was written so far is on the disk, where the system can do so."""
    if hasattr(os, "sync"):
        os.sync()
