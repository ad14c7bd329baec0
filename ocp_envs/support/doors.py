"""Doors: public functions and classes that check their arguments against their annotations, before anything else.

What an argument may be is declared once, by its annotation, and told by :mod:`ocp_envs.support.kinds`. Shapes and
ranges are checked by the function itself.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

from ocp_envs.support.kinds import Fault, Kind, kinds_of

T = TypeVar("T")


def checked(target: T) -> T:
    """The function or class ``target``, whose arguments are checked against their annotations at each call.

    The call raises a TypeError for a value of another type, and a ValueError for one out of its range.
    """
    if isinstance(target, type):
        target.__init__ = _checked(target.__init__, target.__name__)  # type: ignore[misc]
        return target
    function: Any = target
    return cast(T, _checked(function, function.__qualname__.removesuffix(".__init__")))


def _checked(function: Callable[..., Any], owner: str) -> Callable[..., Any]:
    names, kinds = tuple(inspect.signature(function).parameters), dict[str, Kind]()
    faults: list[Callable[[object], Fault]] = []  # by position: most calls have no other arguments, and have to be fast

    def refuse(name: str, value: object, fault: type[Exception]) -> None:
        got = f"{type(value).__name__} " * (fault is TypeError) + _shown(value)
        raise fault(f"{name}: expected {kinds[name].words}, got {got}; see help({owner})")

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        if not faults:
            kinds.update(kinds_of(function))
            faults.extend(kinds[name].fault if name in kinds else _anything for name in names)
        for position, (fault, value) in enumerate(zip(faults, arguments)):
            if found := fault(value):
                refuse(names[position], value, found)
        for name, value in named.items():
            if name in kinds and (found := kinds[name].fault(value)):
                refuse(name, value, found)
        return function(*arguments, **named)

    return call


def _anything(value: object) -> Fault:
    return None


def _shown(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."
