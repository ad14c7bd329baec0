"""Compiled kernels calculate what CasADi's interpreter calculates, and rows do not depend on their batch."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ocp_envs import problems
from ocp_envs.envs.simulation import Simulator
from ocp_envs.support import compiler, kernels
from ocp_envs.support.batch import BatchFunction, dense_function
from ocp_envs.support.compiler import CompiledNotAvailable, find_compiler
from ocp_envs.support.kernels import kernel

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
ROWS = 45  # no whole number of vectors
SPECIAL = (np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e-310, -1.0, 1e9)
#: Rounding of elementary functions, relative to the largest value of a row.
ROUNDING = 1e-13


def interpreted(function, *arguments):
    return BatchFunction(function.function, np.inf)(*arguments)


def check_finite(found, wanted):
    """What is not finite is the same; whether an overflow ends in ∞ or, as ∞ − ∞, in NaN is a matter of rounding."""
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(np.isfinite(one), np.isfinite(other))


def check(found, wanted):
    check_finite(found, wanted)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
        finite = np.isfinite(other)
        scale = np.abs(np.where(finite, other, 0.0)).reshape(len(other), -1).max(axis=1, initial=1.0)
        error = np.abs(np.where(finite, one - np.where(finite, other, 0.0), 0.0)).reshape(len(other), -1)
        assert (error.max(axis=1, initial=0.0) <= ROUNDING * scale).all(), error.max()
        np.testing.assert_array_equal(one[~finite & ~np.isnan(other)], other[~finite & ~np.isnan(other)])


def of_problem(problem):
    """Functions that are evaluated on rows, with their arguments (x, u, s, …)."""
    step = Simulator(problem, 0.02)
    rng, system = np.random.default_rng(0), problem.system
    x, u = (
        system.state.draw(rng, ROWS) / 2,
        system.control.draw(rng, ROWS),
    )  # far from the singularity of a pitch of π/2
    s, h = problem.context.draw(rng, ROWS), rng.uniform(0.01, 0.1, (ROWS, 1))
    found = {
        "step": (step._plain, (x, u, s)),
        "rate": (problem.functions.rate(), (x, u, s)),
        "flow": (problem.functions.flow(2), (x, u, s, h)),
        "linearisation": (problem.functions.linearisation(1).jacobian, (x, u, s, h)),
    }
    return found | ({"clearances": (problem.functions.clearances(), (x, s))} if problem.n_clearances else {})


@pytest.mark.parametrize("name", problems.names())
def test_kernels_of_the_catalogue_are_the_interpreted_functions(name):
    for function, arguments in of_problem(problems.load(name)).values():
        assert kernel(function.function) is not None
        check(function(*arguments), interpreted(function, *arguments))
        for value in SPECIAL:
            broken = [argument.copy() for argument in arguments]
            for argument in broken:
                if argument.size:
                    argument[7 : 7 + argument.shape[1], : argument.shape[1]][np.eye(argument.shape[1], dtype=bool)] = (
                        value
                    )
            # Values may differ: the sine of a huge sum of products says nothing.
            check_finite(function(*broken), interpreted(function, *broken))


@pytest.mark.parametrize("name", problems.names())
def test_a_row_depends_neither_on_its_place_nor_on_its_batch(name):
    for function, arguments in of_problem(problems.load(name)).values():
        whole = function(*arguments)
        for first in range(1, 9):
            for part, all_rows in zip(function(*(a[first:] for a in arguments)), whole, strict=True):
                np.testing.assert_array_equal(part, all_rows[first:])


A, B = ca.SX.sym("a"), ca.SX.sym("b")
ELEMENTARY = (
    *("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh"),
    *("atanh", "floor", "ceil", "fabs", "sign", "erf", "log1p", "expm1"),
)
ONE = {name: getattr(ca, name) for name in ELEMENTARY} | {
    "neg": lambda a: -a,
    "square": lambda a: a**2,
    "inverse": lambda a: 1 / a,
    "cube": lambda a: a**3,
    "not": ca.logic_not,
}
TWO = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": lambda a, b: a**b,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "if_else": lambda a, b: ca.if_else(a, b, 2.0),
} | {name: getattr(ca, name) for name in ("fmin", "fmax", "fmod", "atan2", "copysign", "hypot", "remainder")}
GRID = np.stack(np.meshgrid(*2 * [(*SPECIAL, 0.3, -0.7, 2.5, -3.0, 30.0)]), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_every_instruction_is_that_of_the_interpreter(name):
    expression = ONE[name](A) if name in ONE else TWO[name](A, B)
    function = BatchFunction(dense_function("f", [ca.vertcat(A, B)], [ca.SX(expression)]))
    assert kernel(function.function) is not None
    check(function(GRID), interpreted(function, GRID))


def expressions():
    leaf = st.sampled_from([A, B]) | st.floats(-3, 3).map(ca.SX)
    smooth = ["sin", "cos", "tanh", "atan", "fabs", "neg", "square", "floor", "sign"]
    two = ["add", "sub", "mul", "fmin", "fmax", "lt", "le", "if_else", "and"]
    return st.recursive(
        leaf,
        lambda inner: (
            st.tuples(st.sampled_from(smooth), inner).map(lambda c: ONE[c[0]](c[1]))
            | st.tuples(st.sampled_from(two), inner, inner).map(lambda c: TWO[c[0]](c[1], c[2]))
        ),
        max_leaves=12,
    )


@settings(max_examples=15)
@given(outputs=st.lists(expressions(), min_size=1, max_size=4))
def test_kernels_of_random_expressions(outputs):
    function = dense_function("f", [A, B], [ca.vertcat(*(ca.SX(output) for output in outputs))])
    rng = np.random.default_rng(0)
    arguments = [rng.uniform(-2, 2, (64, 1)), rng.uniform(-2, 2, (64, 1))]
    wanted = np.array([np.ravel(function(a, b)) for a, b in zip(*map(np.ravel, arguments))])
    (found,) = BatchFunction(function)(*arguments)
    # Comparisons and roundings of values that differ in the last place may differ: all but a few rows agree.
    assert np.mean(np.abs(found - wanted).max(axis=1) <= 1e-9 * (1 + np.abs(wanted).max(axis=1))) > 0.9


def test_what_has_no_kernel_is_interpreted():
    x = ca.MX.sym("x", 2)
    assert kernel(ca.Function("of_matrices", [x], [x + 1])) is None
    assert kernel(ca.Function("printed", [A], [A.printme(ca.SX(1))])) is None


def test_long_functions_are_interpreted(monkeypatch):
    monkeypatch.setattr(kernels, "MOST_INSTRUCTIONS", 2)
    assert kernel(dense_function("f", [A], [ca.sin(A) + 1])) is None


def test_without_a_compiler_functions_are_interpreted(monkeypatch):
    compiler._warn_once.cache_clear()
    monkeypatch.setenv("CC", "none")
    function = BatchFunction(dense_function("f", [A], [ca.sin(A) + 2.5]))
    with pytest.warns(CompiledNotAvailable, match="no C compiler"):
        (found,) = function(np.ones((100, 1)))
    np.testing.assert_allclose(found, np.sin(1) + 2.5)


def test_bound_functions_use_the_kernel():
    function = dense_function("f", [A, B], [A * ca.sin(B), B])
    bound = BatchFunction(function).bind(50)
    for array, value in zip(bound.inputs, (2.0, 0.5)):
        array[:] = value
    bound()
    np.testing.assert_allclose(bound.outputs[0], 2 * np.sin(0.5))
    np.testing.assert_array_equal(bound.outputs[1], 0.5)
