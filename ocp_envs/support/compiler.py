"""The C compiler, where there is one, and the libraries that it makes.

The name of a library is a hash of what it was made from, of the versions of CasADi and of the compiler, the flags and
the CPU; :mod:`ocp_envs.support.libraries` keeps them. The environment variable ``CC`` names the compiler.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TypeVar

import casadi as ca

from ocp_envs.support.libraries import cache_folder, forget, trusted_library
from ocp_envs.support.provenance import cpu_model

Loaded = TypeVar("Loaded")
#: Flags for the instructions of this processor; libraries are never used on another.
NATIVE = ("-march=native",) if platform.machine() in ("x86_64", "AMD64") else ()


class CompiledNotAvailable(UserWarning):
    """Interpreted functions are used: results agree to rounding, calculations take several times as long."""


@cache
def _warn_once(reason: str) -> None:
    warnings.warn(f"functions are interpreted, not compiled: {reason}", CompiledNotAvailable, stacklevel=4)


def find_compiler() -> str | None:
    """Path of the C compiler: ``$CC``, or the first of cc, gcc and clang on the path; ``None`` without one."""
    candidates = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((found for name in candidates if (found := shutil.which(name))), None)


@cache
def _compiler_version(compiler: str) -> str:
    return subprocess.run([compiler, "--version"], capture_output=True, check=True).stdout.decode(errors="replace")


@cache
def written_by(*modules: str) -> str:
    """A hash of the source of ``modules`` that write C, which tells their libraries from those of other versions."""
    return hashlib.sha256(b"".join(Path(str(sys.modules[name].__file__)).read_bytes() for name in modules)).hexdigest()


def compiled(
    kind: str, content: object, write: Callable[[], str], flags: Sequence[str], load: Callable[[Path], Loaded]
) -> Loaded | None:
    """What ``load`` makes of the library of a C program; ``None``, and one warning, where that is impossible.

    Args:
        kind: what the library's name begins with.
        content: what the program is made from, whose ``repr`` identifies it.
        write: returns the C; it is called where the library is not there yet.
        flags: those of the compiler.
        load: of the library's path; a ``RuntimeError`` or ``OSError`` says that it does not load.
    """
    compiler = find_compiler()
    if compiler is None:
        _warn_once("no C compiler found (cc, gcc or clang; set CC to name another)")
        return None
    try:
        identity = (content, ca.__version__, _compiler_version(compiler), tuple(flags), cpu_model())
        name = f"{kind}-{hashlib.sha256(repr(identity).encode()).hexdigest()[:32]}"
        library = trusted_library(name, lambda: _compile(write(), flags, compiler))
    except subprocess.CalledProcessError as error:
        message = error.stderr.decode(errors="replace").strip() if error.stderr else ""
        _warn_once(f"{compiler} failed: {message.splitlines()[-1] if message else error}")
        return None
    except OSError as error:
        _warn_once(str(error))
        return None
    try:
        return load(library)
    except (OSError, RuntimeError) as error:
        forget(library)  # the next process builds it again
        _warn_once(f"{library} does not load and was removed ({str(error).splitlines()[-1]})")
        return None


def _compile(source: str, flags: Sequence[str], compiler: str) -> bytes:
    with tempfile.TemporaryDirectory(dir=cache_folder(), prefix="build-") as folder:
        written, built = Path(folder, "functions.c"), Path(folder, "functions.so")
        written.write_text(source)
        command = [compiler, "-fPIC", "-shared", *flags, str(written), "-o", str(built), "-lm"]
        subprocess.run(command, check=True, capture_output=True)
        return built.read_bytes()
