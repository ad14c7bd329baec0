"""What somebody who mistyped a name may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

#: Similarity from which a name is worth suggesting; difflib's own limit of 0.6 misses "pendulum" for the full names.
CUTOFF = 0.3


def did_you_mean(name: object, names: Iterable[str]) -> str:
    """For an error message: a question with the nearest of ``names`` and a space at its end, or nothing."""
    nearest = difflib.get_close_matches(str(name), list(names), n=1, cutoff=CUTOFF)
    return f"did you mean {nearest[0]!r}? " if nearest else ""
