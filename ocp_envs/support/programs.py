"""Programs in C that call functions of a problem step by step: for recursions whose steps take longer in Python.

CasADi writes the functions as C. They are compiled together with a program, whose sizes are macros. Without a compiler
there is no library, and callers do the same with NumPy; results agree but for rounding.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.compiler import NATIVE, compiled, find_compiler

#: Functions with more operations take too long to compile.
MOST_OPERATIONS = 20_000
#: No fused operations: their rounding would depend on the machine.
FLAGS = ("-O3", *NATIVE, "-ffp-contract=off", "-w")


def library(program: Path, functions: Sequence[ca.Function], sizes: Mapping[str, int]) -> ctypes.CDLL | None:
    """The library of the C ``program`` with the ``functions`` it calls; ``None`` where it cannot be made.

    Args:
        program: a file that may use the functions by their names, and ``NAME_W``, the sizes of their work vectors.
        functions: CasADi functions with dense outputs.
        sizes: macros of the program by name.
    """
    if any(function.n_nodes() > MOST_OPERATIONS for function in functions):
        return None
    work = {f"{function.name().upper()}_W": function.sz_w() for function in functions}
    macros = "".join(f"#define {name} {value}\n" for name, value in {**sizes, **work}.items())
    return _loaded(macros + program.read_text(), tuple(f.serialize() for f in functions), find_compiler())


@lru_cache(maxsize=32)
def _loaded(program: str, functions: tuple[str, ...], compiler: str | None) -> ctypes.CDLL | None:
    """The library of ``program`` and serialised ``functions``, as long as this is the ``compiler``."""

    def write() -> str:
        generator = ca.CodeGenerator("functions.c")
        for function in functions:
            generator.add(ca.Function.deserialize(function))
        # Straight-line code gains nothing from more, and takes minutes to compile.
        calls = f'#pragma GCC push_options\n#pragma GCC optimize("O1")\n{generator.dump()}\n#pragma GCC pop_options\n'
        return calls + program

    return compiled("program", (program, functions), write, FLAGS, lambda path: ctypes.CDLL(str(path)))


def address(array: NDArray[np.generic]) -> ctypes.c_void_p:
    """Where the values of ``array`` are, which must be contiguous."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)
