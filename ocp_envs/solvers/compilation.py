"""Compiled solver functions, kept in a folder private to the user.

CasADi writes the functions of a nonlinear program (objective, constraints and their derivatives) as C; compiled
functions are three to five times as fast as interpreted ones. The name of a library is a hash of what it was made from:
the serialised program, the solver that uses it, the versions of CasADi and of the compiler, the flags and the CPU. It
is built under a lock in a temporary folder and moved into place in one step, so that several processes may need it at
once and a killed process leaves no incomplete library.

Environment variables: ``OCP_ENVS_CACHE`` is the folder (default: the user's cache folder), ``CC`` the compiler.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from functools import cache
from pathlib import Path

import casadi as ca
from filelock import FileLock

from ocp_envs.support.provenance import cpu_model

#: -O1 evaluates as fast as -O2 here (within 3 %) and compiles in two thirds of the time. ``-w``: the C is generated.
FLAGS = ("-O1", "-fPIC", "-shared", "-w")


class CompiledNotAvailable(UserWarning):
    """Interpreted functions are used: results are the same, solves take several times as long."""


@cache
def _warn_once(reason: str) -> None:
    warnings.warn(f"solver functions are interpreted, not compiled: {reason}", CompiledNotAvailable, stacklevel=3)


def chosen_folder() -> Path:
    """Where the libraries are to be."""
    if chosen := os.environ.get("OCP_ENVS_CACHE"):
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ocp_envs"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "ocp_envs" / "cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ocp_envs"


def cache_folder() -> Path:
    """The folder of the libraries, created on demand with access for its owner only.

    Raises:
        OSError: it cannot be created, or belongs to another user.
    """
    folder = chosen_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "getuid"):
        status = folder.stat()
        if status.st_uid != os.getuid():
            raise OSError(f"{folder} belongs to another user; set OCP_ENVS_CACHE to another folder")
        if status.st_mode & 0o077:
            folder.chmod(0o700)
    return folder


def find_compiler() -> str | None:
    """Path of the C compiler: ``$CC``, or the first of cc, gcc and clang on the path; ``None`` without one."""
    candidates = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((found for name in candidates if (found := shutil.which(name))), None)


@cache
def _compiler_version(compiler: str) -> str:
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
        library.unlink(missing_ok=True)  # the next process builds it again
        _warn_once(f"{library} does not load and was removed ({str(error).splitlines()[-1]})")
    return ca.nlpsol("solver", plugin, nlp, options)


def _library(plugin: str, nlp: ca.Function, options: dict[str, object], compiler: str) -> Path:
    """The compiled functions of ``nlp`` for ``plugin``; built where necessary."""
    # The serialised program stands for the C generated from it: CasADi's version is part of the key, and writing the C
    # takes longer than loading the library.
    content = (nlp.serialize(), plugin, ca.__version__, _compiler_version(compiler), FLAGS, cpu_model())
    path = cache_folder() / f"{plugin}-{hashlib.sha256(repr(content).encode()).hexdigest()[:32]}.so"
    if path.exists():
        return path
    with FileLock(f"{path}.lock"):
        if not path.exists():
            with tempfile.TemporaryDirectory(dir=path.parent, prefix="build-") as folder:
                _compile(ca.nlpsol("solver", plugin, nlp, options), compiler, Path(folder), path)
    return path


def _compile(solver: ca.Function, compiler: str, folder: Path, path: Path) -> None:
    # What ``generate_dependencies`` does; that one can write into the working directory only.
    generator = ca.CodeGenerator("functions.c")
    generator.add(solver.oracle())
    for name in solver.get_function():
        generator.add(solver.get_function(name))
    source, built = folder / "functions.c", folder / "functions.so"
    source.write_text(generator.dump())
    subprocess.run([compiler, *FLAGS, str(source), "-o", str(built)], check=True, capture_output=True)
    os.replace(built, path)


def cure() -> str:
    """What to do where a process that loads the libraries dies."""
    return (
        f"a compiled library in {chosen_folder()} may be damaged: remove that folder, which is filled again, or set "
        "OCP_ENVS_CACHE to another"
    )
