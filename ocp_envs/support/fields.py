"""Checks of the values of a declaration, one at a time.

Each returns the value in its proper type. A value of another Python type is refused with a ``TypeError``, one out of
its range with a ``ValueError``; both name the argument (``name``) of what is declared (``owner``), and what was got.
"""

from __future__ import annotations

import keyword
import math
import numbers
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from ocp_envs.support.arrays import Array, Ints, frozen_array

Kind = TypeVar("Kind")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _number(owner: str, name: str, value: object, expected: str) -> float:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        raise TypeError(f"{owner}: {name} must be {expected}, got {_short(value)}")
    return float(value)


def real(owner: str, name: str, value: object) -> float:
    """``value`` of the argument ``name`` of ``owner`` as a number, finite or not."""
    return _number(owner, name, value, "a number")


def finite(owner: str, name: str, value: object) -> float:
    """``value`` of the argument ``name`` of ``owner`` as a finite number."""
    number = _number(owner, name, value, "a finite number")
    if not math.isfinite(number):
        raise ValueError(f"{owner}: {name} must be a finite number, got {value!r}")
    return number


def positive(owner: str, name: str, value: object) -> float:
    """``value`` of the argument ``name`` of ``owner`` as a positive finite number."""
    number = _number(owner, name, value, "a positive finite number")
    if not 0 < number < math.inf:
        raise ValueError(f"{owner}: {name} must be positive and finite, got {value!r}")
    return number


def not_negative(owner: str, name: str, value: object) -> float:
    """``value`` of the argument ``name`` of ``owner`` as a finite number of 0 or more."""
    number = _number(owner, name, value, "a finite number ≥ 0")
    if not 0 <= number < math.inf:
        raise ValueError(f"{owner}: {name} must be a finite number ≥ 0, got {value!r}")
    return number


def whole(owner: str, name: str, value: object, least: int) -> int:
    """``value`` of the argument ``name`` of ``owner`` as a whole number of ``least`` or more."""
    number = _number(owner, name, value, f"a whole number ≥ {least}")
    if not math.isfinite(number) or number != int(number) or number < least:
        raise ValueError(f"{owner}: {name} must be a whole number, {name} ≥ {least}, got {value!r}")
    return int(number)


def interval(owner: str, name: str, value: object) -> tuple[float, float]:
    """``value`` of the argument ``name`` of ``owner`` as a pair of finite numbers, 0 < shortest ≤ longest."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or len(value) != 2:
        raise TypeError(f"{owner}: {name} must be a pair (shortest, longest), got {_short(value)}")
    low, high = (_number(owner, name, bound, "a pair of finite numbers") for bound in value)
    if not 0 < low <= high < math.inf:
        raise ValueError(f"{owner}: {name} must be finite, with 0 < shortest ≤ longest, got {_short(value)}")
    return low, high


def identifier(owner: str, name: str, value: object) -> str:
    """``value`` of the argument ``name`` of ``owner`` as a Python identifier that is no keyword."""
    if not isinstance(value, str):
        raise TypeError(f"{owner}: {name} must be a Python identifier, got {_short(value)}")
    if not value.isidentifier() or keyword.iskeyword(value):
        raise ValueError(f"{owner}: {name} must be a Python identifier and no keyword, got {value!r}")
    return value


def words(owner: str, name: str, value: object) -> str:
    """``value`` of the argument ``name`` of ``owner`` as a text that is not empty."""
    if not isinstance(value, str):
        raise TypeError(f"{owner}: {name} must be a text, got {_short(value)}")
    if not value.strip():
        raise ValueError(f"{owner}: {name} must not be empty")
    return value


def instance(owner: str, name: str, value: object, kind: type[Kind]) -> Kind:
    """``value`` of the argument ``name`` of ``owner`` as an instance of the class ``kind``."""
    if not isinstance(value, kind):
        raise TypeError(f"{owner}: {name} must be a {kind.__name__}, got {_short(value)}")
    return value


def function(owner: str, name: str, value: object) -> None:
    """Refuse a ``value`` of the argument ``name`` of ``owner`` that cannot be called."""
    if not callable(value):
        raise TypeError(f"{owner}: {name} must be a function, got {_short(value)}")


def _array(owner: str, name: str, values: object, expected: str) -> Array:
    try:
        array = np.array(values)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{owner}: {name} must be {expected}, got {_short(values)}") from error
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{owner}: {name} must be {expected}, got {_short(values)}")
    return array.astype(np.float64)


def vector(owner: str, name: str, values: object) -> Array:
    """``values`` of the argument ``name`` of ``owner`` as a read-only vector of finite numbers."""
    array = _array(owner, name, values, "a vector of numbers")
    if array.ndim != 1:
        raise ValueError(f"{owner}: {name} must be a vector, got the shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{owner}: {name} must be finite, got {array}")
    return frozen_array(array)


def whole_rows(owner: str, name: str, values: object) -> Ints:
    """``values`` of the argument ``name`` of ``owner`` as a read-only array of whole numbers, whose rows differ."""
    array = _array(owner, name, values, "rows of whole numbers")
    if array.ndim != 2 or not len(array):
        raise ValueError(f"{owner}: {name} must have at least one row, (W, nx), got the shape {array.shape}")
    if not np.isfinite(array).all() or (array != np.round(array)).any():
        raise ValueError(f"{owner}: {name} must be whole numbers of turns, got {_short(array.tolist())}")
    if len(np.unique(array, axis=0)) < len(array):
        raise ValueError(f"{owner}: two rows of {name} are equal: {_short(array.astype(int).tolist())}")
    return frozen_array(array, np.int64)
