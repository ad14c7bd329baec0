"""Compiled solver functions.

CasADi writes the functions of a nonlinear program (objective, constraints and their derivatives) as C; compiled
functions are three to five times as fast as interpreted ones. The name of a library is a hash of what it was made from:
the serialised program, the solver that uses it, the versions of CasADi and of the compiler, the flags and the CPU.
:mod:`ocp_envs.solvers.libraries` keeps them. The environment variable ``CC`` names the compiler.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import warnings
from functools import cache
from pathlib import Path

import casadi as ca

from ocp_envs.solvers.libraries import cache_folder, forget, trusted_library
from ocp_envs.support.provenance import cpu_model

#: -O1 evaluates as fast as -O2 here (within 3 %) and compiles in two thirds of the time. ``-w``: the C is generated.
FLAGS = ("-O1", "-fPIC", "-shared", "-w")


class CompiledNotAvailable(UserWarning):
    """Interpreted functions are used: results are the same, solves take several times as long."""


@cache
def _warn_once(reason: str) -> None:
    warnings.warn(f"solver functions are interpreted, not compiled: {reason}", CompiledNotAvailable, stacklevel=3)


def find_compiler() -> str | None:
    """Path of the C compiler: ``$CC``, or the first of cc, gcc and clang on the path; ``None`` without one."""
    candidates = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((found for name in candidates if (found := shutil.which(name))), None)


@cache
def compiler_version(compiler: str) -> str:
    """What the C ``compiler`` says of its version."""
    return subprocess.run([compiler, "--version"], capture_output=True, check=True).stdout.decode(errors="replace")


def build_solver(plugin: str, nlp: ca.Function, options: dict[str, object]) -> ca.Function:
    """``casadi.nlpsol`` with compiled functions; with interpreted ones and one warning where that is impossible.

    The ``plugin`` is "fatrop" or "ipopt", ``nlp`` the function (x, p) → (f, g); ``options`` are those of ``nlpsol``.

    Raises:
        RuntimeError: CasADi refuses the program or the options.
    """
    compiler = find_compiler()
    if compiler is None:
        _warn_once("no C compiler found (cc, gcc or clang; set CC to name another)")
        return ca.nlpsol("solver", plugin, nlp, options)
    library = None
    try:
        library = _library(plugin, nlp, options, compiler)
        return ca.nlpsol("solver", plugin, str(library), options)
    except subprocess.CalledProcessError as error:
        message = error.stderr.decode(errors="replace").strip() if error.stderr else ""
        _warn_once(f"{compiler} failed: {message.splitlines()[-1] if message else error}")
    except OSError as error:
        _warn_once(str(error))
    except RuntimeError as error:
        if library is None:
            raise
        forget(library)  # the next process builds it again
        _warn_once(f"{library} does not load and was removed ({str(error).splitlines()[-1]})")
    return ca.nlpsol("solver", plugin, nlp, options)


def _library(plugin: str, nlp: ca.Function, options: dict[str, object], compiler: str) -> Path:
    """The compiled functions of ``nlp`` for ``plugin``; built where necessary."""
    # The serialised program stands for the C generated from it: CasADi's version is part of the key, and writing the C
    # takes longer than loading the library.
    content = (nlp.serialize(), plugin, ca.__version__, compiler_version(compiler), FLAGS, cpu_model())
    name = f"{plugin}-{hashlib.sha256(repr(content).encode()).hexdigest()[:32]}"
    return trusted_library(name, lambda: _compiled(ca.nlpsol("solver", plugin, nlp, options), compiler))


def _compiled(solver: ca.Function, compiler: str) -> bytes:
    # What ``generate_dependencies`` does; that one can write into the working directory only.
    generator = ca.CodeGenerator("functions.c")
    generator.add(solver.oracle())
    for name in solver.get_function():
        generator.add(solver.get_function(name))
    with tempfile.TemporaryDirectory(dir=cache_folder(), prefix="build-") as folder:
        source, built = Path(folder, "functions.c"), Path(folder, "functions.so")
        source.write_text(generator.dump())
        subprocess.run([compiler, *FLAGS, str(source), "-o", str(built)], check=True, capture_output=True)
        return built.read_bytes()
