"""What a database says of itself: the attributes of its Zarr group, which carry a checksum."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ocp_envs.data.layout import CURE, DatabaseError
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.checksums import intact, with_checksum
from ocp_envs.support.provenance import plain, write_json

FORMAT = "ocp-moe database"
VERSION = 2
_FILE = "zarr.json"
#: What Zarr wants to find in the same file.
_GROUP = {"zarr_format": 3, "node_type": "group"}
#: Attributes of version 1, which has no checksum, with their types.
_FIRST_VERSION = {"problem": str, "fingerprint": str, "modes": list, "chunk": int, "settings": dict}


@dataclass(frozen=True, kw_only=True)
class Description:
    """A database of the ``problem`` with that id, its ``fingerprint`` and the names of its ``modes``.

    It was made with ``settings`` (JSON); ``chunk`` rows are written at a time. It was made for the first of ``sizes``
    instances and has grown to each of the others; its arrays are being prepared for ``growing`` instances, unless this
    is ``None``. Once ``finished``, all its chunks exist; what was finished before it grew exists in any case. Its files
    have the format ``version``.

    Raises:
        DatabaseError: fewer than one row written at a time.
    """

    problem: str
    fingerprint: str
    modes: list[str]
    chunk: int
    settings: dict[str, object]
    sizes: list[int]
    growing: int | None = None
    finished: bool = False
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.chunk < 1:
            raise DatabaseError(f"chunk must be at least 1, got {self.chunk}")

    @property
    def size(self) -> int:
        """Number of instances."""
        return self.sizes[-1]

    @property
    def safe(self) -> int:
        """Number of the first rows that must exist."""
        if self.finished:
            return self.size
        return self.sizes[-2] if len(self.sizes) > 1 else 0

    def check_made_for(self, problem: OptimalControlProblem, path: Path) -> None:
        """Raise a DatabaseError where the database at ``path`` was made for something other than ``problem``."""
        if (self.problem, self.fingerprint) != (problem.id, problem.fingerprint):
            raise DatabaseError(
                f"{path} was made for {self.problem} with fingerprint {self.fingerprint}, not for {problem.id} with "
                f"{problem.fingerprint}: the problem is another one or has changed since; generate it again"
            )
        expected = list(problem.modes.names)
        if self.modes != expected:
            raise DatabaseError(
                f"{path} holds the solution families {self.modes}, {problem.id} has {expected}: their declaration has "
                "changed since; generate it again"
            )


def write_description(path: Path, description: Description) -> None:
    """Write the ``description`` of the database in the folder ``path``, in one step."""
    write_attributes(path, {"format": FORMAT, **asdict(description)})


def write_attributes(path: Path, attributes: Mapping[str, object]) -> None:
    """Write the ``attributes`` of the Zarr group in the folder ``path`` with a checksum, in one step."""
    write_json(path / _FILE, {"attributes": with_checksum(plain(attributes)), **_GROUP})


def read_description(path: Path) -> Description:
    """What the database in the folder ``path`` says of itself.

    Raises:
        DatabaseError: not a database, of another format, or damaged.
    """
    attributes = _attributes(path)
    found, version = attributes.get("format"), attributes.get("version")
    if found != FORMAT:
        raise DatabaseError(f"{path} is not a database of this program: got format {found!r:.99}, expected {FORMAT!r}")
    if version not in (1, VERSION) or isinstance(version, bool):
        raise DatabaseError(f"{path} has format version {version!r:.99}, expected 1 or {VERSION}; generate it again")
    if version == 1:
        return _first_version(path, attributes)
    _check_intact(path, attributes)
    return Description(**{name: value for name, value in attributes.items() if name not in ("format", "checksum")})


def read_attributes(path: Path) -> Mapping[str, Any]:
    """The attributes of the Zarr group in the folder ``path``, whose checksum is compared.

    Raises:
        DatabaseError: no Zarr group of this program, or damaged.
    """
    attributes = _attributes(path)
    _check_intact(path, attributes)
    return attributes


def _check_intact(path: Path, attributes: Mapping[str, Any]) -> None:
    if not intact(attributes):
        raise DatabaseError(f"{path / _FILE} is damaged, or was edited: the checksum of its attributes differs; {CURE}")


def _attributes(path: Path) -> Mapping[str, Any]:
    """The attributes of the Zarr group in the folder ``path``."""
    try:
        content = json.loads((path / _FILE).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        message = f"{path} is not a database, or its description {_FILE} is damaged ({error})"
        raise DatabaseError(message) from error
    group = content if isinstance(content, dict) else {}
    attributes = group.get("attributes")
    if any(group.get(name) != value for name, value in _GROUP.items()) or not isinstance(attributes, dict):
        raise DatabaseError(f"{path} is not a database, or its description {_FILE} is damaged: it is no Zarr group")
    return attributes


def _first_version(path: Path, attributes: Mapping[str, Any]) -> Description:
    """The description of a database of version 1; the number of instances is that of its parameters."""
    known: dict[str, Any] = {name: attributes.get(name) for name in _FIRST_VERSION}
    for name, kind in _FIRST_VERSION.items():
        if type(known[name]) is not kind:
            expected = f"expected a JSON value of the type {kind.__name__}"
            raise DatabaseError(f"{path / _FILE} is damaged: {name} is {known[name]!r:.99}, {expected}")
    try:
        size = json.loads((path / "parameters" / _FILE).read_bytes())["shape"][0]
        if type(size) is not int or size < 0:
            raise ValueError(f"a number of instances of {size!r:.99}")
    except (OSError, ValueError, RecursionError, LookupError, TypeError) as error:
        raise DatabaseError(f"{path} is damaged: its parameters are not described ({error})") from error
    return Description(**known, sizes=[size], version=1)
