"""Programs in C that call functions of a problem step by step: for recursions whose steps take longer in Python.

CasADi writes the functions as C. They are compiled together with a program, which is one or several files and whose
sizes are macros. Without a compiler there is no library, and callers do the same with NumPy; results agree but for
rounding.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import casadi as ca

from ocp_envs.support.compiler import NATIVE, compiled, find_compiler

#: Functions with more operations take too long to compile.
MOST_OPERATIONS = 20_000
#: No fused operations: their rounding would depend on the machine.
FLAGS = ("-O3", *NATIVE, "-ffp-contract=off", "-w")
_KINDS: Mapping[str, Any] = {"q": ctypes.c_longlong, "d": ctypes.c_double, "p": ctypes.c_void_p}


def library(program: Sequence[Path], functions: Sequence[ca.Function], sizes: Mapping[str, int]) -> ctypes.CDLL | None:
    """The library of the C ``program`` with the ``functions`` it calls; ``None`` where it cannot be made.

    Args:
        program: files, one after another, that may use the functions by their names, and ``NAME_W``, the sizes of
            their work vectors.
        functions: CasADi functions with dense outputs.
        sizes: macros of the program by name.
    """
    if any(function.n_nodes() > MOST_OPERATIONS for function in functions):
        return None
    return _loaded(text(program, functions, sizes), tuple(f.serialize() for f in functions), find_compiler())


def entry(program: ctypes.CDLL, name: str, arguments: str) -> Callable[..., None]:
    """The function ``name`` of the library ``program``.

    Each letter of ``arguments`` is an argument: long long (q), double (d), or an address (p), which is a whole number
    or an array of C (:mod:`ocp_envs.support.arrays`).
    """
    found = program[name]
    found.argtypes, found.restype = [_KINDS[letter] for letter in arguments], None
    return cast("Callable[..., None]", found)


def text(program: Sequence[Path], functions: Sequence[ca.Function], sizes: Mapping[str, float]) -> str:
    """The C of ``program`` with its macros, those of ``functions`` and ``sizes`` as for :func:`library`."""
    work = {f"{function.name().upper()}_W": function.sz_w() for function in functions}
    macros = "".join(f"#define {name} {value}\n" for name, value in {**sizes, **work}.items())
    return "\n".join([macros, *(path.read_text() for path in program)])


@lru_cache(maxsize=32)
def _loaded(program: str, functions: tuple[str, ...], compiler: str | None) -> ctypes.CDLL | None:
    """The library of ``program`` and serialised ``functions``, as long as this is the ``compiler``."""

    def write() -> str:
        calls = written([ca.Function.deserialize(function) for function in functions], "functions")
        # Straight-line code gains nothing from more, and takes minutes to compile.
        return f'#pragma GCC push_options\n#pragma GCC optimize("O1")\n{calls}\n#pragma GCC pop_options\n{program}'

    return compiled("program", (program, functions), write, FLAGS, lambda path: ctypes.CDLL(str(path)))


def written(functions: Sequence[ca.Function], prefix: str) -> str:
    """The C of CasADi's ``functions``; the names of their parts begin with ``prefix``."""
    generator = ca.CodeGenerator(f"{prefix}.c")
    for function in functions:
        generator.add(function)
    return str(generator.dump())
