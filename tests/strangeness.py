"""Strange arguments, and whether an annotation refuses them."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np

import moe_policy
import ocp_envs
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support.rows import Batch
from tests.synthetic import fake_samples


class _Object:
    def __repr__(self) -> str:
        return "<an object>"


#: Values of every kind that users pass by mistake.
STRANGE: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "true": lambda: True,
    "zero": lambda: 0,
    "one": lambda: 1,
    "negative": lambda: -1,
    "huge": lambda: 2**70,
    "many": lambda: 10**9,
    "half": lambda: 0.5,
    "nan": lambda: math.nan,
    "infinity": lambda: math.inf,
    "minus infinity": lambda: -math.inf,
    "largest": lambda: 1e308,
    "least": lambda: 5e-324,
    "complex": lambda: 1j,
    "empty text": lambda: "",
    "text": lambda: "text",
    "digits": lambda: "3",
    "nul": lambda: "a\0b",
    "bytes": lambda: b"bytes",
    "name of a problem": lambda: "PendulumSwingup-v0",
    "path": lambda: Path("/nowhere/at all"),
    "empty list": list,
    "empty tuple": tuple,
    "empty dict": dict,
    "set": lambda: {1, 2},
    "mapping of texts": lambda: {"mass": "heavy"},
    "mapping of numbers": lambda: {1: 2.0},
    "list of texts": lambda: ["a", "b"],
    "list of None": lambda: [None, None],
    "ragged list": lambda: [[1.0, 2.0], [3.0]],
    "list of numbers": lambda: [1.0, 2.0],
    "negative list": lambda: [-1, -2],
    "generator": lambda: (i for i in range(3)),
    "object": _Object,
    "class": lambda: int,
    "function": lambda: lambda *arguments: None,
    "failing function": lambda: lambda *arguments: 1 / 0,
    "empty array": lambda: np.empty(0),
    "scalar array": lambda: np.array(1.0),
    "array of nan": lambda: np.full((2, 2), np.nan),
    "array of texts": lambda: np.array([["a", "b"]]),
    "array of objects": lambda: np.array([[None, 1.0]]),
    "array of complex numbers": lambda: np.ones((2, 2), complex),
    "array of dates": lambda: np.array(["2020-01-01"], "datetime64[D]"),
    "large array": lambda: np.zeros((2, 300)),
    "array of five axes": lambda: np.zeros((1, 2, 3, 4, 5)),
    "problem": lambda: PENDULUM,
    "other problem": lambda: VEHICLE,
    "samples": lambda: fake_samples(3),
    "trajectory": lambda: fake_samples(3).trajectory,
}


def _has_rows(value: object) -> bool:
    return isinstance(value, Batch) or (isinstance(value, np.ndarray) and value.ndim > 0)


#: Changes of a value that fits.
CHANGES: dict[str, tuple[Callable[[Any], bool], Callable[[Any], Any]]] = {
    "one row less": (lambda v: _has_rows(v) and len(v) > 1, lambda v: v[:-1]),
    "no rows": (_has_rows, lambda v: v[:0]),
    "more axes": (lambda v: isinstance(v, np.ndarray), lambda v: v[None, None, None, None]),
    "texts": (lambda v: isinstance(v, np.ndarray), lambda v: v.astype(str)),
    "objects": (lambda v: isinstance(v, np.ndarray), lambda v: v.astype(object)),
    "one nan": (
        lambda v: isinstance(v, np.ndarray) and v.dtype.kind == "f" and v.size > 0,
        lambda v: np.where(np.arange(v.size).reshape(v.shape) == 0, np.nan, v),
    ),
    "minus": (lambda v: isinstance(v, (float, int)) and not isinstance(v, bool), lambda v: -v),
    "far": (lambda v: isinstance(v, (float, np.ndarray)) and np.asarray(v).dtype.kind == "f", lambda v: v * 1e300),
    "another word": (lambda v: isinstance(v, str), lambda v: v + "x"),
    "backwards": (lambda v: isinstance(v, (tuple, list)) and len(v) > 1, lambda v: v[::-1]),
    "one more": (lambda v: isinstance(v, (tuple, list)) and len(v) > 0, lambda v: (*v, v[0])),
    "its class": (lambda v: dataclasses.is_dataclass(v), type),
}

#: What instances of protocols are recognised by.
PROTOCOLS = {"Planner": "__call__", "Policy": "predict", "SampleSource": "samples", "Executor": "submit"}
_NUMBERS = re.compile(r"Array|Ints|Bools|ArrayLike|NDArray\[.*\]")
_SEQUENCE = re.compile(r"(?:Sequence|tuple)\[(\w+).*\]|Hidden|Interval")
_FUNCTION = re.compile(r"Callable\[.*\]|Plans|Dynamics|CostRate|Clearance|Classify")


def alternatives(annotation: str) -> list[str]:
    """The parts of a union."""
    parts, depth = [""], 0
    for letter in annotation:
        depth += (letter in "[(") - (letter in "])")
        if letter == "|" and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _numbers(value: object) -> bool | None:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return False
    return None if array.dtype.kind in "fiub" and array.ndim < 5 else False


def _sequence(kind: str, value: Any) -> bool | None:
    if isinstance(value, (str, bytes)) or not (isinstance(value, Sequence) or _has_rows(value)):
        return False
    wanted = {"int": Integral, "float": Real, "str": str}.get(kind)
    return None if wanted is None or all(isinstance(each, wanted) for each in value) else False


def _whole(value: Any) -> bool | None:
    if isinstance(value, bool) or not isinstance(value, (Real, np.ndarray)):
        return False
    if isinstance(value, Integral):
        return None if value >= 0 else False
    return None if np.ndim(value) == 0 and np.isfinite(value) and value == np.round(value) and value >= 0 else False


def _number(value: Any, finite: bool) -> bool | None:
    if isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "fiu":
        return None  # some take it for a number
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    return None if math.isfinite(value) or not finite else False


def _instance(kind: str, value: Any) -> bool | None:
    if kind in PROTOCOLS:
        return None if hasattr(value, PROTOCOLS[kind]) else False
    cls = getattr(ocp_envs, kind, None) or getattr(moe_policy, kind, None)
    if kind == "ProblemOrId" or (cls is ocp_envs.OptimalControlProblem and isinstance(value, str)):
        known = isinstance(value, str) and value in ocp_envs.names()
        return None if known or isinstance(value, ocp_envs.OptimalControlProblem) else False
    if not inspect.isclass(cls) or getattr(cls, "_is_protocol", False):
        return None
    return None if isinstance(value, cls) else False


def _fits_one(kind: str, value: Any) -> bool | None:
    if kind in ("object", "Any", "State", ""):
        return None
    if kind == "None":
        return value is None
    if kind == "bool":
        return None if isinstance(value, (bool, np.bool_)) or (isinstance(value, int) and value in (0, 1)) else False
    if kind in ("float", "AnyFloat"):
        return _number(value, finite=kind == "float")
    if kind == "int":
        return _whole(value)
    if kind == "str":
        return None if isinstance(value, str) else False
    if kind in ("Path", "os.PathLike[str]", "PathLike"):
        return None if isinstance(value, (str, Path)) else False
    if _NUMBERS.fullmatch(kind):
        return _numbers(value)
    if match := _SEQUENCE.fullmatch(kind):
        return _sequence(match[1] or "", value)
    if kind.startswith("Mapping") or kind.startswith("dict"):
        return None if isinstance(value, Mapping) else False
    if _FUNCTION.fullmatch(kind):
        return None if callable(value) else False
    return _instance(kind, value)


def may_fit(annotation: str, value: Any) -> bool:
    """Whether ``value`` may be an argument of that ``annotation``; ``False`` where it surely is none."""
    return any(_fits_one(kind, value) is not False for kind in alternatives(annotation))
