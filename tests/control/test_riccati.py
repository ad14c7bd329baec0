"""The recursion of no plans."""

import numpy as np

from moe_policy.control.lqr import Regulator
from tests.small_problems import DOUBLE_INTEGRATOR


def test_no_plans_have_no_gains():
    regulator = Regulator(DOUBLE_INTEGRATOR, 0.02)
    empty = regulator.along(np.zeros((0, 4, 2)), np.zeros((0, 3, 1)), np.zeros((0, 0)), np.zeros(0, np.int64))
    assert [part.shape for part in empty] == [(0, 4, 1, 2), (0, 4, 1, 1)]
