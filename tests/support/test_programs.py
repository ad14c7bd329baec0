import ctypes

import casadi as ca
import numpy as np
import pytest

from ocp_envs.support import programs
from ocp_envs.support.arrays import address
from ocp_envs.support.compiler import find_compiler
from ocp_envs.support.libraries import LIBRARY
from ocp_envs.support.programs import entry, library

PROGRAM = """
void twice(const double *x, double *y) {
  double work[SQUARE_W + 1], once[N];
  const double *first[] = {x}, *second[] = {once};
  double *results[] = {once}, *last[] = {y};
  square(first, results, 0, work, 0);
  square(second, last, 0, work, 0);
}
"""
pytestmark = pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable")
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")


@pytest.fixture
def square():
    x = ca.SX.sym("x", 3)
    return ca.Function("square", [x], [x**2])


@pytest.fixture
def program(tmp_path, monkeypatch):
    monkeypatch.setenv("OCP_ENVS_CACHE", str(tmp_path / "cache"))
    programs._loaded.cache_clear()
    path = tmp_path / "twice.c"
    path.write_text(PROGRAM)
    yield [path]
    programs._loaded.cache_clear()


@needs_compiler
def test_a_program_calls_functions_of_casadi(program, square):
    x, y = np.array([1.0, 2.0, 3.0]), np.zeros(3)
    made = library(program, [square], {"N": 3})
    entry(made, "twice", "pp")(address(x), address(y))
    np.testing.assert_array_equal(y, x**4)
    assert isinstance(made, ctypes.CDLL)
    assert library(program, [square], {"N": 3}) is made


@needs_compiler
def test_other_sizes_or_functions_are_another_library(program, square, tmp_path):
    x = ca.SX.sym("x", 3)
    for functions, sizes in (([square], {"N": 3}), ([square], {"N": 4}), ([ca.Function("square", [x], [x])], {"N": 3})):
        assert library(program, functions, sizes) is not None
    assert len(list((tmp_path / "cache").glob(f"*{LIBRARY}"))) == 3


def test_without_a_compiler_there_is_none(program, square, monkeypatch):
    monkeypatch.setenv("CC", "none")
    assert library(program, [square], {"N": 3}) is None


def test_functions_that_take_too_long_to_compile_are_not(program, square, monkeypatch):
    monkeypatch.setattr(programs, "MOST_OPERATIONS", 2)
    assert library(program, [square], {"N": 3}) is None


def test_a_program_that_does_not_compile_is_none(program, square):
    program[0].write_text("this is no C")
    assert library(program, [square], {"N": 3}) is None


@needs_compiler
def test_a_folder_that_cannot_be_used_means_none(program, square, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("OCP_ENVS_CACHE", str(tmp_path / "file"))
    assert library(program, [square], {"N": 3}) is None
