"""Where results come from: versions, machine, commit, memory; and JSON files."""

from __future__ import annotations

import contextlib
import datetime
import importlib.metadata
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ocp_envs.support.doors import checked
from ocp_envs.support.files import replacing

#: A list without lists, dictionaries or texts in it, over several lines; no text of JSON has a line's end in it.
_NUMBERS = re.compile(r"\[\n([^\[\]{}\"]*)\n *\]")
#: The distribution this package is installed from.
_DISTRIBUTION = "ocp-moe"
#: Name of a requirement, and the extra that it belongs to, if any.
_REQUIREMENT = re.compile(r"([\w.-]+)(?:.*\bextra\s*==\s*['\"]([\w.-]+))?")


@checked
@dataclass(frozen=True)
class Provenance:
    """Where a result comes from.

    The ``date`` is UTC, ISO 8601 to the second; the ``commit`` of the git checkout has a ``+`` where files were
    changed. The ``platform`` is the operating system and its version; ``python`` and the ``versions`` of installed
    packages are texts; ``cpu`` is the model of the processor and ``cores`` the number of its logical cores.
    """

    date: str
    commit: str | None
    python: str
    platform: str
    cpu: str
    cores: int | None
    versions: dict[str, str]

    def to_json(self) -> dict[str, object]:
        """As a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Provenance:
        """The inverse of :meth:`to_json`.

        Raises:
            ValueError: ``content`` has other keys.
        """
        expected = [field.name for field in fields(cls)]
        if list(content) != expected:
            raise ValueError(f"expected a provenance with the keys {', '.join(expected)}, got {', '.join(content)}")
        return cls(**content)


@cache
def cpu_model() -> str:
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def provenance() -> Provenance:
    """Versions, machine, date (UTC) and, in a git checkout, the commit a result is made with."""
    return Provenance(
        date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        commit=_commit(),
        python=platform.python_version(),
        platform=platform.platform(),
        cpu=cpu_model(),
        cores=os.cpu_count(),
        versions=_versions(),
    )


def _versions() -> dict[str, str]:
    """Versions of this distribution and of what it requires, development tools excepted; none where not installed."""
    try:
        required = importlib.metadata.requires(_DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        return {}
    parsed = [match.groups() for each in required if (match := _REQUIREMENT.match(each))]
    versions = {}
    for package in (_DISTRIBUTION, *(name for name, extra in parsed if extra != "dev")):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # of an extra that is not installed
            versions[package] = importlib.metadata.version(package)
    return versions


def peak_memory_gb(descendants: bool = False) -> float:
    """Peak memory so far in GB (2³⁰ bytes), including the pages in memory of mapped files.

    It is that of this process, or of the largest of its ``descendants`` that have ended.
    """
    import resource  # only POSIX has it

    who = resource.RUSAGE_CHILDREN if descendants else resource.RUSAGE_SELF
    unit = 2**30 if sys.platform == "darwin" else 2**20  # macOS counts in bytes, others in KiB
    return resource.getrusage(who).ru_maxrss / unit


def _commit() -> str | None:
    """Commit of the checkout this package lies in, with ``+`` where files were changed; ``None`` outside of one."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return None

    def git(*arguments: str) -> str:
        return subprocess.check_output(["git", *arguments], cwd=folder, text=True, stderr=subprocess.DEVNULL).strip()

    try:
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def _plain_value(value: object) -> object:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Provenance):
        return value.to_json()
    raise TypeError(f"cannot write {type(value).__name__} as JSON")


def plain(content: Mapping[str, object]) -> dict[str, object]:
    """The JSON object ``content`` as it is read back: NumPy arrays and numbers are lists and numbers.

    Raises:
        TypeError, ValueError: something that JSON cannot hold, such as NaN or infinity.
    """
    found: dict[str, object] = json.loads(json.dumps(content, default=_plain_value, allow_nan=False))
    return found


def write_json(path: str | os.PathLike[str], content: Mapping[str, object]) -> None:
    """Write ``content`` as indented JSON to the file ``path``, in one step; its folder is made.

    NumPy arrays and numbers become lists and numbers; a list of numbers stands on one line.

    Raises:
        TypeError, ValueError: something that JSON cannot hold, such as NaN or infinity; the old file stays.
    """
    text = json.dumps(plain(content), indent=2, allow_nan=False) + "\n"
    text = _NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
    with replacing(path) as file:
        file.write(text.encode())
