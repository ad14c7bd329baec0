"""Compiled libraries in a folder that is private to the user; only what this program has put there is loaded.

Loading a library runs it. A library is trusted if it is a regular file of this user that nobody else may write, in such
a folder, and if its content has the hash that was recorded next to it. The hash also finds a library that a power
failure or a full disk has damaged. What is not trusted is removed and built again.

The environment variable ``OCP_ENVS_CACHE`` names the folder (default: in the user's cache folder).
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

from ocp_envs.support.files import replacing

#: Suffixes of a library, of the record of its hash and of the lock under which it is built.
LIBRARY, RECORD, LOCK = ".so", ".so.sha256", ".so.lock"
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class UntrustedLibrary(UserWarning):
    """Something in the folder of the libraries is not trusted; it was removed."""


def chosen_folder() -> Path:
    """Where the libraries are to be."""
    if chosen := os.environ.get("OCP_ENVS_CACHE"):
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ocp_envs"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "ocp_envs" / "cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ocp_envs"


def cure() -> str:
    """What to do where a process that loads the libraries dies."""
    return (
        f"a compiled library in {chosen_folder()} may be damaged: remove that folder, which is filled again, or set "
        "OCP_ENVS_CACHE to another"
    )


def cache_folder() -> Path:
    """The folder of the libraries, created on demand with access for its owner only.

    Libraries in a folder that others could write are removed.

    Raises:
        OSError: it cannot be created, belongs to another user, or others can replace it.
    """
    folder = chosen_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not hasattr(os, "getuid"):
        return folder
    for path, status in ((folder, folder.lstat()), (folder, folder.stat())):  # a link and what it leads to
        if status.st_uid != os.getuid():
            raise OSError(f"{path} belongs to another user; set OCP_ENVS_CACHE to another folder")
    for parent in folder.resolve().parents:
        mode = parent.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise OSError(f"everybody can rename folders in {parent}; set OCP_ENVS_CACHE to a folder elsewhere")
    mode = folder.stat().st_mode
    if mode & 0o077:
        folder.chmod(0o700)
    if mode & _OTHERS_WRITE:
        _empty(folder)
    return folder


def _empty(folder: Path) -> None:
    removed = [path for path in folder.iterdir() if path.name.endswith((LIBRARY, RECORD, LOCK))]
    for path in removed:
        _remove(path)
    if removed:
        warnings.warn(
            f"others could write to {folder}: it is private now, and the libraries in it were removed",
            UntrustedLibrary,
            stacklevel=2,
        )


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        raise OSError(f"{path} is a folder where a file is expected; remove it")
    path.unlink(missing_ok=True)


def trusted_library(name: str, build: Callable[[], bytes]) -> Path:
    """The library ``name``, with the content that ``build`` returns where there is none yet that can be trusted.

    It is built under a lock and moved into place in one step, so that several processes may need it at once and a
    killed process leaves no incomplete library.

    Raises:
        OSError: the folder cannot be used, or a folder has the name of the library.
    """
    folder = cache_folder()
    path = folder / f"{name}{LIBRARY}"
    if _distrust(path) is None:
        return path
    lock = folder / f"{name}{LOCK}"
    if lock.is_symlink():
        _remove(lock)
    with FileLock(lock):
        reason = _distrust(path)
        if reason is None:
            return path
        if reason:
            warnings.warn(f"{path} {reason}: it was removed and is built again", UntrustedLibrary, stacklevel=2)
        forget(path)
        content = build()
        with replacing(path) as file:
            file.write(content)
        with replacing(_record(path)) as file:
            file.write(_hash(path.name, content).encode())
    return path


def forget(path: Path) -> None:
    """Remove the library ``path`` and its record.

    Raises:
        OSError: it is a folder.
    """
    _remove(path)
    _remove(_record(path))


def _record(path: Path) -> Path:
    return path.with_name(path.name.removesuffix(LIBRARY) + RECORD)


def _hash(name: str, content: bytes) -> str:
    return hashlib.sha256(name.encode() + b"\n" + content).hexdigest()


def _distrust(path: Path) -> str | None:
    """Why the library ``path`` is not trusted, "" where it is missing or has no record; ``None`` where it is."""
    for part in (path, _record(path)):
        try:
            status = part.lstat()
        except FileNotFoundError:
            return ""
        if stat.S_ISDIR(status.st_mode):
            raise OSError(f"{part} is a folder where a file is expected; remove it")
        if not stat.S_ISREG(status.st_mode):
            return "is no regular file" if part == path else "has a record that is no regular file"
        if hasattr(os, "getuid"):
            if status.st_uid != os.getuid():
                return "belongs to another user"
            if status.st_mode & _OTHERS_WRITE:
                return "could be written by others"
    return None if _record(path).read_bytes() == _hash(path.name, path.read_bytes()).encode() else "is damaged"
