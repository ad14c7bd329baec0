"""Derivatives that are put together from those of one interval are those that CasADi derives."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

from ocp_envs import problems
from ocp_envs.solvers import compilation
from ocp_envs.solvers.compilation import build_solver
from ocp_envs.solvers.derivatives import written_out
from ocp_envs.solvers.nlp import SolverSettings, Task
from ocp_envs.solvers.plugins import Plugin, _options
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.support.compiler import find_compiler
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

PROBLEMS = {problem.id: problem for problem in (DOUBLE_INTEGRATOR, WALLED_INTEGRATOR)}
PROBLEMS |= {name: problems.load(name) for name in problems.names()}
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")


def casadis(program):
    options = _options(program, "fatrop", 1e-6, 150)
    return ca.nlpsol("solver", "fatrop", program.nlp, options)


@pytest.mark.parametrize("name", PROBLEMS)
def test_functions_are_those_that_casadi_derives(name):
    program = transcribe(PROBLEMS[name])
    solver, source = casadis(program), np.random.default_rng(0)
    for function_name, function in written_out(program).functions.items():
        wanted = solver.get_function(function_name)
        assert (function.name_in(), function.name_out()) == (wanted.name_in(), wanted.name_out())
        for _ in range(3):
            point = [source.uniform(0.1, 0.5, wanted.numel_in(i)) for i in range(wanted.n_in())]
            for one, other in zip(function.call(point), wanted.call(point), strict=True):
                assert other.sparsity().is_subset(one.sparsity()), "an entry is missing"
                np.testing.assert_allclose(one.full(), other.full(), atol=1e-11)


def test_every_loop_over_stages_becomes_a_kernel():
    program = transcribe(WALLED_INTEGRATOR)
    written = written_out(program)
    text = compilation._functions_of(casadis(program), written.functions)
    loops = set(re.findall(r"/\* map\d+_(\w+):", text))
    assert loops == {function.name() for function in written.stages} - {
        "interval",
        "clearances",
        "mixed",
        "mixed_jacobian",
    }
    vectorised = compilation._vectorised(text, written.stages)
    assert all(f"  rows_{name}(20, arg, res);\n  return 0;\n" in vectorised for name in loops)
    assert "casadi_real* *res1" not in vectorised


def test_long_functions_stay_loops(monkeypatch):
    monkeypatch.setattr(compilation, "MOST_INSTRUCTIONS", 3)
    program = transcribe(WALLED_INTEGRATOR)
    written = written_out(program)
    text = compilation._functions_of(casadis(program), written.functions)
    assert "rows_stage_hessian" not in compilation._vectorised(text, written.stages)


@needs_compiler
def test_iterations_are_those_of_the_interpreted_program():
    program = transcribe(WALLED_INTEGRATOR)
    options = _options(program, "fatrop", SolverSettings().tolerance, 150)
    backends = [Plugin(program, make) for make in (build_solver("fatrop", program, options), casadis(program))]
    guess = np.clip(np.random.default_rng(0).uniform(-0.3, 0.3, len(program.lower)), program.lower, program.upper)
    task = Task(guess, np.array([3.0, 0.0, 8.0]), 0)
    (one, first), (other, second) = [backend.run(task, *program.bounds(0, task.parameter[2:])) for backend in backends]
    assert (one, first) == (other, second)
    np.testing.assert_allclose(backends[0].w, backends[1].w, atol=1e-8)
