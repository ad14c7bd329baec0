import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.guesses import guesses
from tests.solvers.programs import DISC


@pytest.mark.parametrize("kind", ["line", "rollout", "drift"])
def test_guesses_are_bounded_and_start_right(kind):
    rng = np.random.default_rng(1)
    p = np.array([[0.1, 1.9], [6.2, -2.0]])
    plans = guesses(PENDULUM, p, np.array([0, 2]), rng, kind)
    np.testing.assert_array_equal(plans.states[:, 0], p)
    assert PENDULUM.system.state.contains(plans.states).all()
    assert PENDULUM.system.control.contains(plans.controls).all()
    if kind != "rollout":
        np.testing.assert_allclose(plans.states[:, -1], PENDULUM.targets[[0, 2]], atol=1e-12)


def test_bent_guesses_pass_an_obstacle_on_every_side():
    p, winding = np.tile([[-3.0, 0.3, 1.0]], (60, 1)), np.zeros(60, int)
    bent = guesses(DISC, p, winding, np.random.default_rng(0), "bend")
    straight = guesses(DISC, p, winding, np.random.default_rng(0), "line")
    np.testing.assert_allclose(bent.states[:, 0], straight.states[:, 0])
    np.testing.assert_allclose(bent.states[:, -1], straight.states[:, -1])
    box = DISC.system.state
    assert ((bent.states >= box.lower) & (bent.states <= box.upper)).all()
    middle = (bent.states - straight.states)[:, DISC.knots // 2]
    assert (middle > 0.1).any(axis=0).all()
    assert (middle < -0.1).any(axis=0).all()
