"""Suggestions for mistyped names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

#: Similarity from which a name is worth suggesting; difflib's own limit of 0.6 misses "pendulum" for the full names.
CUTOFF = 0.3


def did_you_mean(name: object, names: Iterable[str]) -> str:
    """A question such as ``"did you mean 'snn'? "`` where one of the ``names`` is similar to ``name``; else empty."""
    nearest = difflib.get_close_matches(str(name), list(names), n=1, cutoff=CUTOFF)
    return f"did you mean {nearest[0]!r}? " if nearest else ""
