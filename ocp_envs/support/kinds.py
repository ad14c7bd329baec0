"""What an annotation allows an argument to be.

- ``float`` is a finite number; :data:`AnyFloat` may be NaN or infinite, too;
- ``int`` is a whole number ≥ 0: no public function takes a negative one;
- ``bool`` and ``str`` are that alone; of a ``Literal``, one of its values;
- ``ArrayLike`` and NumPy's types of arrays are numbers of that kind, as an array or as nested sequences;
- a sequence, a tuple or a mapping has elements that are checked, and a text is no sequence;
- anything else is an instance of its class; a protocol has to be ``runtime_checkable``.
"""

from __future__ import annotations

import builtins
import collections.abc
import inspect
import math
import os
import sys
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

_NOT_FINITE = "may be NaN or infinite"
#: A number that may be NaN or infinite, such as a result.
AnyFloat: TypeAlias = Annotated[float, _NOT_FINITE]
#: What is wrong with a value: ``None``, or the class of the exception.
Fault = type[TypeError] | type[ValueError] | None


class Kind(NamedTuple):
    """What an argument may be: in ``words``, and ``fault`` of a value."""

    words: str
    fault: Callable[[Any], Fault]


def kinds_of(function: Callable[..., Any]) -> dict[str, Kind]:
    """What the arguments of ``function`` may be, by name."""
    names = _Names(function.__globals__)
    return {
        parameter.name: kind_of(parameter.annotation, names)
        for parameter in inspect.signature(function).parameters.values()
        if parameter.kind is not parameter.VAR_KEYWORD and parameter.annotation is not parameter.empty
    }


class _Names(dict[str, Any]):
    """The names of a module, and those that it imports for type checkers alone, if another module has them by now."""

    def __missing__(self, name: str) -> Any:
        if hasattr(builtins, name):
            return getattr(builtins, name)
        root = self["__name__"].partition(".")[0]
        modules = [vars(module) for key, module in list(sys.modules.items()) if key.partition(".")[0] == root]
        return next((names[name] for names in modules if name in names), object)


def kind_of(annotation: object, names: Mapping[str, Any]) -> Kind:
    """What an ``annotation`` allows; a text is read with ``names``."""
    if not isinstance(annotation, str):
        return _kind(annotation)
    return _any([_kind(eval(part, {}, names)) for part in _alternatives(annotation)])


def _alternatives(annotation: str) -> list[str]:
    """The parts of a union; NumPy's ArrayLike, a union itself, has to stay whole."""
    parts, depth = [""], 0
    for letter in annotation:
        depth += (letter in "[(") - (letter in "])")
        if letter == "|" and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _any(kinds: Sequence[Kind]) -> Kind:
    def fault(value: object) -> Fault:
        found: Fault = TypeError
        for kind in kinds:
            if (fault := kind.fault(value)) is None:
                return None
            found = ValueError if fault is ValueError else found
        return found

    return kinds[0] if len(kinds) == 1 else Kind(" or ".join(dict.fromkeys(kind.words for kind in kinds)), fault)


def _kind(annotation: Any) -> Kind:
    """What a type allows."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if annotation in _SIMPLE:
        return _SIMPLE[annotation]
    if annotation == ArrayLike or origin is np.ndarray:
        return _array(arguments[1] if arguments and origin is np.ndarray else None)
    if origin in (typing.Union, types.UnionType):
        return _any([_kind(each) for each in arguments])
    if origin is Annotated:
        return _number(finite=_NOT_FINITE not in arguments)
    if origin is typing.Literal:
        return Kind(f"one of {', '.join(map(repr, arguments))}", lambda value: _literal(value, arguments))
    if origin is collections.abc.Callable:
        return Kind("a function", lambda value: None if callable(value) else TypeError)
    if origin is collections.abc.Mapping or origin is dict:
        return _mapping(*map(_kind, arguments))
    if origin in (collections.abc.Sequence, tuple, list):
        return _sequence(_kind(arguments[0]), None if origin is not tuple or ... in arguments else len(arguments))
    if origin is type:
        return Kind("a class", lambda value: None if isinstance(value, type) else TypeError)
    if annotation is Path or origin is os.PathLike:
        return Kind("str or PathLike", _path)
    cls = origin or annotation
    if not isinstance(cls, type) or cls is object:
        return _ANYTHING
    if getattr(cls, "_is_protocol", False):
        return Kind(cls.__name__, lambda value: None if _implements(value, cls) else TypeError)
    return Kind(cls.__name__, lambda value: None if isinstance(value, cls) else TypeError)


def _implements(value: object, protocol: type) -> bool:
    return not isinstance(value, type) and isinstance(value, protocol)


def _number(finite: bool = True) -> Kind:
    def fault(value: object) -> Fault:
        if isinstance(value, bool) or not isinstance(value, Real):
            return TypeError
        return ValueError if finite and not _is_finite(value) else None

    return Kind("a finite number" if finite else "a number", fault)


def _is_finite(value: Real) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer that no float is as large as
        return False


def _whole(value: object) -> Fault:
    if isinstance(value, bool) or not isinstance(value, Integral):
        return TypeError
    return None if 0 <= int(value) < 2**63 else ValueError


def _literal(value: object, values: tuple[object, ...]) -> Fault:
    if any(type(value) is type(each) for each in values):
        return None if value in values else ValueError
    return TypeError


def _array(dtype: Any) -> Kind:
    """Numbers; whole ones where the ``dtype`` of the type says so, or truth values."""
    scalar = typing.get_args(dtype)[0] if dtype is not None else None
    letters, words, least = "fiub", "numbers", 0 if dtype is None else 1
    if isinstance(scalar, type) and issubclass(scalar, np.bool_):
        letters, words = "b", "truth values"
    elif isinstance(scalar, type) and issubclass(scalar, np.integer):
        letters, words = "iu", "whole numbers"

    def fault(value: object) -> Fault:
        if type(value) is np.ndarray and value.dtype.kind in letters and least <= value.ndim <= 4:
            return None  # the usual case, which has to be fast
        if isinstance(value, str | bytes | Mapping) or value is None:
            return TypeError
        try:
            array = np.asarray(value)
        except (TypeError, ValueError):
            return TypeError
        empty = not array.size and array.dtype.kind == "f"  # of no type in particular
        numbers = array.dtype.kind in letters or empty
        return None if numbers and least <= array.ndim <= 4 else TypeError

    return Kind(f"{words} (an array, or nested sequences of equal length)", fault)


def _sequence(each: Kind, length: int | None) -> Kind:
    def fault(value: Any) -> Fault:
        if isinstance(value, str | bytes) or not (
            isinstance(value, Sequence) or (isinstance(value, np.ndarray) and value.ndim)
        ):
            return TypeError
        found = next((found for found in map(each.fault, value) if found), None)
        return ValueError if not found and length not in (None, len(value)) else found

    return Kind(f"a sequence{'' if length is None else f' of {length}'}, each {each.words}", fault)


def _mapping(key: Kind, item: Kind) -> Kind:
    def fault(value: object) -> Fault:
        if not isinstance(value, Mapping):
            return TypeError
        faults = [*map(key.fault, value), *map(item.fault, value.values())]
        return next((found for found in faults if found), None)

    return Kind(f"a mapping from {key.words} to {item.words}", fault)


def _path(value: object) -> Fault:
    return TypeError if not isinstance(value, str | os.PathLike) else _text(os.fspath(value))


def _text(value: object) -> Fault:
    return TypeError if not isinstance(value, str) else ValueError if "\0" in value else None


def _of_class(words: str, *classes: type) -> Kind:
    return Kind(words, lambda value: None if isinstance(value, classes) else TypeError)


_ANYTHING = Kind("anything", lambda value: None)
_SIMPLE: dict[Any, Kind] = {
    Any: _ANYTHING,
    None: Kind("None", lambda value: None if value is None else TypeError),
    type(None): Kind("None", lambda value: None if value is None else TypeError),
    bool: _of_class("True or False", bool, np.bool_),
    str: Kind("str", _text),
    float: _number(),
    int: Kind("a whole number of at least 0", _whole),
}
