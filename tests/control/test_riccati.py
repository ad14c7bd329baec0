"""The compiled recursion does what the one with NumPy does."""

import numpy as np
import pytest

from moe_policy.control.lqr import Regulator
from moe_policy.control.program import compiled
from moe_policy.control.resampling import Resampler
from ocp_envs.problems import BENCHMARK
from ocp_envs.support.compiler import find_compiler
from tests.plans import random_plan
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")


def along(problem, dt=0.02, size=5, shortened=False):
    plans, contexts = random_plan(problem, size)
    reference = Resampler(problem, dt)(plans, contexts)
    steps = reference.steps - np.arange(size) if shortened else reference.steps
    return Regulator(problem, dt).along(reference.states, reference.controls, contexts, steps)


CASES = [(problem, 0.02) for problem in (*BENCHMARK, WALLED_INTEGRATOR)] + [(DOUBLE_INTEGRATOR, 0.05)]


@pytest.mark.parametrize(("problem", "dt"), CASES, ids=lambda value: getattr(value, "id", str(value)))
def test_both_recursions_have_the_same_gains(problem, dt, monkeypatch):
    assert compiled(problem, 1) is not None
    in_c = along(problem, dt, shortened=True)
    monkeypatch.setenv("CC", "none")
    assert compiled(problem, 1) is None
    for one, other in zip(in_c, along(problem, dt, shortened=True), strict=True):
        scale = np.abs(other).max(axis=(2, 3), keepdims=True)
        np.testing.assert_allclose(one, other, atol=1e-9 * scale.max(), rtol=1e-7)


def test_no_plans_have_no_gains():
    gains, norms = along(DOUBLE_INTEGRATOR, size=1)
    assert gains.shape[0] == norms.shape[0] == 1
    regulator = Regulator(DOUBLE_INTEGRATOR, 0.02)
    empty = regulator.along(np.zeros((0, 4, 2)), np.zeros((0, 3, 1)), np.zeros((0, 0)), np.zeros(0, np.int64))
    assert [part.shape for part in empty] == [(0, 4, 1, 2), (0, 4, 1, 1)]
