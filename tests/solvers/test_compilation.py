import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from ocp_envs.solvers.compilation import build_solver
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.support import compiler
from ocp_envs.support.compiler import CompiledNotAvailable, find_compiler
from ocp_envs.support.libraries import UntrustedLibrary, forget, trusted_library
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR

OPTIONS = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("OCP_ENVS_CACHE", str(tmp_path / "cache"))
    compiler._warn_once.cache_clear()
    return tmp_path / "cache"


def solve(solver):
    p = np.array([[3.0, 0.5]])
    return solver.solve(
        p, guesses(DOUBLE_INTEGRATOR, p, np.array([0]), np.random.default_rng(0), "line"), np.array([0])
    )


def libraries(folder):
    return sorted(path.name for path in folder.iterdir() if path.suffix == ".so")


@needs_compiler
def test_compiled_and_interpreted_agree_and_the_library_is_kept(folder, monkeypatch):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled = solve(Solver(DOUBLE_INTEGRATOR))
    (name,) = libraries(folder)
    made = (folder / name).stat().st_mtime_ns
    solve(Solver(DOUBLE_INTEGRATOR))
    assert libraries(folder) == [name]
    assert (folder / name).stat().st_mtime_ns == made
    monkeypatch.setattr(compiler, "find_compiler", lambda: None)
    with pytest.warns(CompiledNotAvailable):
        interpreted = solve(Solver(DOUBLE_INTEGRATOR))
    np.testing.assert_allclose(compiled.trajectory.flat(), interpreted.trajectory.flat(), atol=1e-7)
    assert compiled.iterations == interpreted.iterations


@needs_compiler
def test_another_program_or_solver_is_another_library(folder):
    program = transcribe(DOUBLE_INTEGRATOR)
    build_solver("ipopt", program, OPTIONS)
    build_solver("ipopt", transcribe(DOUBLE_INTEGRATOR.with_constants(mass=2.0)), OPTIONS)
    assert len(libraries(folder)) == 2


def test_without_a_compiler_one_warning_and_a_solution(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.warns(CompiledNotAvailable, match="no C compiler found") as caught:
        solutions = [solve(Solver(DOUBLE_INTEGRATOR)) for _ in range(2)]
    assert len([w for w in caught if w.category is CompiledNotAvailable]) == 1
    assert all(solution.solved.all() for solution in solutions)


def test_a_compiler_that_fails_is_no_compiler(monkeypatch, tmp_path):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\n[ $1 = --version ] || { echo 'out of order' >&2; exit 1; }\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    with pytest.warns(CompiledNotAvailable, match="out of order"):
        assert solve(Solver(DOUBLE_INTEGRATOR)).solved.all()


def test_a_compiler_that_cannot_tell_its_version_is_no_compiler(monkeypatch, tmp_path):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho 'no developer tools' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    with pytest.warns(CompiledNotAvailable, match="no developer tools"):
        assert solve(Solver(DOUBLE_INTEGRATOR)).solved.all()


@needs_compiler
def test_a_library_that_does_not_load_is_replaced(folder):
    program = transcribe(DOUBLE_INTEGRATOR)
    build_solver("ipopt", program, OPTIONS)
    (name,) = libraries(folder)
    forget(folder / name)
    trusted_library(name.removesuffix(".so"), lambda: b"not a library")  # as a compiler for another machine makes it
    with pytest.warns(CompiledNotAvailable, match="does not load"):
        build_solver("ipopt", program, OPTIONS)
    assert libraries(folder) == []
    build_solver("ipopt", program, OPTIONS)
    assert libraries(folder) == [name]


@needs_compiler
def test_a_truncated_library_is_built_again_and_never_loaded(folder):
    """Loaded, it would end the process with SIGBUS."""
    program = transcribe(DOUBLE_INTEGRATOR)
    build_solver("ipopt", program, OPTIONS)
    (name,) = libraries(folder)
    size = (folder / name).stat().st_size
    os.truncate(folder / name, 5000)
    with pytest.warns(UntrustedLibrary, match="is damaged"):
        build_solver("ipopt", program, OPTIONS)
    assert (folder / name).stat().st_size == size


def test_a_folder_that_cannot_be_used(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("OCP_ENVS_CACHE", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(compiler, "find_compiler", lambda: sys.executable)
    with pytest.warns(CompiledNotAvailable):
        assert solve(Solver(DOUBLE_INTEGRATOR, SolverSettings(primary="ipopt"))).solved.all()


@needs_compiler
def test_two_processes_at_once(folder):
    code = (
        "import warnings; warnings.simplefilter('error')\n"
        "from ocp_envs.solvers.compilation import build_solver\n"
        "from ocp_envs.solvers.transcription import transcribe\n"
        "from tests.small_problems import DOUBLE_INTEGRATOR\n"
        f"build_solver('ipopt', transcribe(DOUBLE_INTEGRATOR), {OPTIONS!r})\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path)}
    processes = [subprocess.Popen([sys.executable, "-c", code], env=environment) for _ in range(2)]
    assert [process.wait(60) for process in processes] == [0, 0]
    assert len(libraries(folder)) == 1
    assert not list(folder.glob("build-*"))
