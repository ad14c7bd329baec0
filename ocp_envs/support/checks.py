"""Checks of single arguments."""

from __future__ import annotations

import math
from numbers import Integral, Real


def check_whole(name: str, value: object, least: int = 1, most: int | None = None) -> None:
    """Refuse a ``value`` of the argument ``name`` that is no whole number from ``least`` to ``most``.

    Raises:
        TypeError: no whole number; truth values and floats are none.
        ValueError: a whole number outside the range.
    """
    wanted = f"a whole number of at least {least}" if most is None else f"a whole number in {least} … {most}"
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name}: expected {wanted}, got {value!r}")
    if int(value) < least or (most is not None and int(value) > most):
        raise ValueError(f"{name}: expected {wanted}, got {value}")


def check_number(name: str, value: object, wanted: str = "a finite number", lower: float = -math.inf) -> None:
    """Refuse a ``value`` of the argument ``name`` that is no finite number above ``lower``; ``wanted`` says so.

    Raises:
        TypeError: no number; truth values are none.
        ValueError: a number that is not finite, or not above ``lower``.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name}: expected {wanted}, got {value!r}")
    if not (math.isfinite(value) and float(value) > lower):
        raise ValueError(f"{name}: expected {wanted}, got {value}")


def check_kind(name: str, value: object, kind: type | tuple[type, ...], cure: str = "") -> None:
    """Refuse with a TypeError a ``value`` of the argument ``name`` that is of no ``kind``; the message ends with a
    ``cure``.
    """
    if not isinstance(value, kind):
        kinds = " or ".join(each.__name__ for each in (kind if isinstance(kind, tuple) else (kind,)))
        got = f"{type(value).__name__} {' '.join(repr(value).split()):.80}"
        raise TypeError(f"{name}: expected {kinds}, got {got}{cure and '; ' + cure}")
