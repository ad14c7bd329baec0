"""Programs in C that call functions of a problem step by step: for recursions whose steps take longer in Python.

CasADi writes the functions as C. They are compiled together with a program, whose sizes are macros, into a library that
is kept as those of the solver are. Without a compiler there is no kernel, and callers do the same with NumPy; results
agree but for rounding.
"""

from __future__ import annotations

import ctypes
import hashlib
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ocp_envs.solvers.compilation import compiler_version, find_compiler
from ocp_envs.solvers.libraries import cache_folder, forget, trusted_library
from ocp_envs.support.provenance import cpu_model

#: Functions with more operations take too long to compile.
MOST_OPERATIONS = 20_000
#: No fused operations: their rounding would depend on the machine.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-fPIC", "-shared", "-w")


def kernel(program: Path, functions: Sequence[ca.Function], sizes: Mapping[str, int]) -> ctypes.CDLL | None:
    """The library of the C ``program`` with the ``functions`` it calls; ``None`` where it cannot be made.

    Args:
        program: a file that may use the functions by their names, and ``NAME_W``, the sizes of their work vectors.
        functions: CasADi functions with dense outputs.
        sizes: macros of the program by name.
    """
    compiler = find_compiler()
    if compiler is None or any(function.n_nodes() > MOST_OPERATIONS for function in functions):
        return None
    work = {f"{function.name().upper()}_W": function.sz_w() for function in functions}
    macros = "".join(f"#define {name} {value}\n" for name, value in {**sizes, **work}.items())
    return _loaded(macros + program.read_text(), tuple(f.serialize() for f in functions), compiler, cpu_model())


@lru_cache(maxsize=32)
def _loaded(program: str, functions: tuple[str, ...], compiler: str, processor: str) -> ctypes.CDLL | None:
    """The library of ``program`` and serialised ``functions``, for this ``compiler`` and ``processor``."""
    try:
        content = (program, functions, ca.__version__, compiler_version(compiler), FLAGS, processor)
        name = f"kernel-{hashlib.sha256(repr(content).encode()).hexdigest()[:32]}"
        path = trusted_library(name, lambda: _compiled(program, functions, compiler))
    except (OSError, subprocess.CalledProcessError):
        return None
    try:
        return ctypes.CDLL(str(path))
    except OSError:
        forget(path)  # the next process builds it again
        return None


def _compiled(program: str, functions: Sequence[str], compiler: str) -> bytes:
    generator = ca.CodeGenerator("functions.c")
    for function in functions:
        generator.add(ca.Function.deserialize(function))
    # Straight-line code gains nothing from more, and takes minutes to compile.
    calls = f'#pragma GCC push_options\n#pragma GCC optimize("O1")\n{generator.dump()}\n#pragma GCC pop_options\n'
    with tempfile.TemporaryDirectory(dir=cache_folder(), prefix="build-") as folder:
        source, built = Path(folder, "kernel.c"), Path(folder, "kernel.so")
        source.write_text(calls + program)
        subprocess.run([compiler, *FLAGS, str(source), "-lm", "-o", str(built)], check=True, capture_output=True)
        return built.read_bytes()


def address(array: NDArray[np.generic]) -> ctypes.c_void_p:
    """Where the values of ``array`` are, which must be contiguous."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)
