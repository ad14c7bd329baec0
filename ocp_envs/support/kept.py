"""What is derived from an immutable value, kept with that value."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache, partial, wraps
from typing import Concatenate, ParamSpec, TypeVar, cast

Value = TypeVar("Value")
Result = TypeVar("Result")
P = ParamSpec("P")
#: Results kept for each function and value; beyond that the one used least recently goes.
KEPT = 8


def kept(function: Callable[Concatenate[Value, P], Result]) -> Callable[Concatenate[Value, P], Result]:
    """``function`` of an immutable value and further hashable arguments, whose last :data:`KEPT` results are kept.

    They are in the ``__dict__`` of the value, as those of ``functools.cached_property``, and end with it. A value whose
    copies and pickles are to lack them needs a ``__reduce__`` of its own. Threads may share the value and the results.
    """
    name = f"_kept_{function.__module__}.{function.__qualname__}"

    @wraps(function)
    def derived(value: Value, /, *args: P.args, **kwargs: P.kwargs) -> Result:
        results = value.__dict__.get(name)
        if results is None:  # of two threads, the first one's is kept
            results = value.__dict__.setdefault(name, lru_cache(maxsize=KEPT)(partial(function, value)))
        return cast("Result", results(*cast("tuple[Hashable, ...]", args), **kwargs))

    return derived
