import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.nlp import Status
from ocp_envs.solvers.solutions import best_per_mode
from tests.solvers.programs import line

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]


def test_a_mode_that_was_not_found_is_empty(pendulum):
    found = pendulum.solve(*line(PENDULUM, [[np.pi - 0.5, 0.0]] * 2, 1))
    best = best_per_mode(PENDULUM, np.array([np.pi - 0.5, 0.0]), found)
    np.testing.assert_array_equal(best.status, [Status.EMPTY, Status.SOLVED, Status.EMPTY])
    np.testing.assert_array_equal(np.isfinite(best.cost), best.solved)
    np.testing.assert_array_equal(best.trajectory.finite, best.solved)
