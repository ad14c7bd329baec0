"""Functions of a declaration, called with CasADi symbols; what goes wrong there is told in the words of the field."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ocp_envs.support.doors import checked
from ocp_envs.support.suggestions import did_you_mean

_CASADI = (ca.SX, ca.MX, ca.DM)


class Names(SimpleNamespace):
    """Values by name, as functions of a declaration read them: ``c.mass``.

    Args:
        kind: what the names are called in messages, such as ``"constant"``.
        values: the values by name.
        read: a set to which the names are added that are read; by default one of its own.

    A name that is not there is refused with an ``AttributeError`` that says which are.
    """

    @checked
    def __init__(self, kind: str, values: Mapping[str, object], read: set[str] | None = None) -> None:
        super().__init__(**values)
        noted = set() if read is None else read
        self.__dict__["/kind"], self.__dict__["/read"] = kind, noted  # no identifiers, so that no name is in the way

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        if not name.startswith("__"):
            self.__dict__["/read"].add(name)
        return value

    def __getattr__(self, name: str) -> Any:
        there = [each for each in self.__dict__ if not each.startswith("/")]
        kind = self.__dict__.get("/kind", "name")
        raise AttributeError(f"there is no {kind} {name!r}; {did_you_mean(name, there)}there are {there}")


def _cure(error: Exception, signature: str) -> str:
    text = str(error)
    if "truth value" in text or "__bool__" in text:
        return "; instead of Python's if, and, min or max, write ca.if_else, ca.logic_and, ca.fmin or ca.fmax"
    if isinstance(error, TypeError) and "positional argument" in text:
        return f"; it is called with ({signature})"
    if isinstance(error, TypeError | RuntimeError | NotImplementedError):
        return (
            "; its arguments are CasADi symbols, so use CasADi's functions (ca.sin) instead of those of math and NumPy"
        )
    return ""


def called(what: str, signature: str, function: Callable[..., Any], *arguments: object) -> Any:
    """``function(*arguments)``; its exceptions become a ``ValueError`` that says how to write it.

    Args:
        what: whose function it is, for messages, such as ``"pendulum: dynamics"``.
        signature: the names of its arguments, for messages.
        function: what a user has written.
        arguments: CasADi symbols and :class:`Names`.
    """
    try:
        return function(*arguments)
    except Exception as error:
        first = str(error).strip().splitlines()[-1] if str(error).strip() else ""
        raise ValueError(f"{what} fails: {type(error).__name__}: {first}{_cure(error, signature)}") from error


def _is_scalar(value: object) -> bool:
    if isinstance(value, _CASADI):
        return bool(value.shape == (1, 1))
    return isinstance(value, numbers.Real) or (isinstance(value, np.ndarray) and value.size == 1)


def _described(value: object) -> str:
    shape = f" of shape {value.shape}" if isinstance(value, (*_CASADI, np.ndarray)) else ""
    return f"{type(value).__name__}{shape}" if shape or value is not None else "None"


def scalar(what: str, value: Any) -> Any:
    """``value`` if it is one expression or number, else a ``ValueError`` of ``what``."""
    if not _is_scalar(value):
        raise ValueError(f"{what} must return one expression, got {_described(value)}")
    return value


def column(what: str, values: Any, names: Sequence[str] | None = None) -> Any:
    """The list ``values`` of expressions as one column, else a ``ValueError`` of ``what``.

    There has to be one for each of ``names``, or at least one.
    """
    each = "" if names is None else f", one for each of {list(names)}"
    if isinstance(values, _CASADI) or not isinstance(values, Sequence | np.ndarray) or isinstance(values, str):
        cure = "; for a column v write ca.vertsplit(v)" if isinstance(values, _CASADI) else ""
        raise ValueError(f"{what} must return a list of expressions{each}, got {_described(values)}{cure}")
    if len(values) != (len(values) or 1 if names is None else len(names)):
        least = "at least 1" if names is None else f"{len(names)}{each}"
        raise ValueError(f"{what} returned {len(values)} components, expected {least}")
    for i, value in enumerate(values):
        if not _is_scalar(value):
            label = f"component {i}" if names is None else f"component {i}, the derivative of {names[i]!r},"
            raise ValueError(f"{what}: {label} must be one expression, got {_described(value)}")
    return ca.vertcat(*values)
