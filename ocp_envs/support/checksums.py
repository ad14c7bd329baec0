"""A checksum of a JSON object, kept in the object itself: any edit shows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping

KEY = "checksum"


def checksum(content: Mapping[str, object], default: Callable[[object], object] | None = None) -> str:
    """SHA-256 of the JSON object ``content``, its own checksum left out, in an order that does not depend on the file.

    ``default`` turns values that JSON does not know into values that it knows, as in ``json.dumps``.
    """
    others = {name: value for name, value in content.items() if name != KEY}
    return hashlib.sha256(json.dumps(others, sort_keys=True, default=default).encode()).hexdigest()


def with_checksum(
    content: Mapping[str, object], default: Callable[[object], object] | None = None
) -> dict[str, object]:
    """The JSON object ``content`` with its checksum; ``default`` is that of :func:`checksum`."""
    return {**content, KEY: checksum(content, default)}


def intact(content: Mapping[str, object]) -> bool:
    """Whether the JSON object ``content`` has the checksum that it carries."""
    return content.get(KEY) == checksum(content)
