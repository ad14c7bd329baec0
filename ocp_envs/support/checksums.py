"""A checksum of a JSON object, kept in the object itself: any edit shows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

KEY = "checksum"


def checksum(content: Mapping[str, object]) -> str:
    """SHA-256 of the JSON object ``content`` without the checksum in it, keys in alphabetical order."""
    others = {name: value for name, value in content.items() if name != KEY}
    return hashlib.sha256(json.dumps(others, sort_keys=True).encode()).hexdigest()


def with_checksum(content: Mapping[str, object]) -> dict[str, object]:
    """The JSON object ``content`` with its checksum."""
    return {**content, KEY: checksum(content)}


def intact(content: Mapping[str, object]) -> bool:
    """Whether the JSON object ``content`` has the checksum that it carries."""
    return content.get(KEY) == checksum(content)
