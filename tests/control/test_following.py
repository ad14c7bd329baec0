"""Plans are made ready for tracking in C as with NumPy."""

import dataclasses
import pickle

import numpy as np
import pytest

from moe_policy.control.following import Following
from moe_policy.control.lqr import Regulator
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.support.compiler import find_compiler
from ocp_envs.trajectory import Trajectory
from tests.plans import random_plan
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

pytestmark = [
    pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
CASES = [(problem, 0.02) for problem in (*BENCHMARK, WALLED_INTEGRATOR)] + [(DOUBLE_INTEGRATOR, 0.05)]


def strange_plans(problem, size=8):
    """Plans partly outside the boxes, one too short, one too long, and one not finite."""
    plans, contexts = random_plan(problem, size, seed=3)
    box, rng = problem.system.state, np.random.default_rng(4)
    states, controls, duration = plans.states.copy(), 1.5 * plans.controls, plans.duration.copy()
    states[2] += rng.normal(0, 0.2, states[2].shape) * box.width
    states[3, 1, 0] = np.nan
    duration[4:7] = [0.01, 1e3, np.inf]
    return Trajectory(states, controls, duration), contexts


def both(problem, dt, monkeypatch):
    """The same in C and with NumPy."""
    regulator = Regulator(problem, dt)
    in_c, with_numpy = Following(regulator), Following(regulator)
    assert in_c._program is not None
    monkeypatch.setenv("CC", "none")
    assert with_numpy._program is None
    return in_c, with_numpy


@pytest.mark.parametrize(("problem", "dt"), CASES, ids=lambda value: getattr(value, "id", str(value)))
@pytest.mark.parametrize("plans", [lambda problem: random_plan(problem, 5), strange_plans], ids=["exact", "strange"])
def test_both_make_the_same_of_plans(problem, dt, plans, monkeypatch):
    in_c, with_numpy = both(problem, dt, monkeypatch)
    one, other = (following(*plans(problem)) for following in (in_c, with_numpy))
    for field in dataclasses.fields(one.schedule):
        np.testing.assert_array_equal(getattr(one.schedule, field.name), getattr(other.schedule, field.name))
    for name in ("states", "controls"):
        box = problem.system.state if name == "states" else problem.system.control
        np.testing.assert_allclose(getattr(one, name) / box.width, getattr(other, name) / box.width, atol=1e-12)
    kept = ~one.schedule.rejected
    for name in ("gains", "norms"):
        left, right = getattr(one, name)[kept], getattr(other, name)[kept]
        scale = np.abs(right).max(axis=(1, 2, 3), keepdims=True)
        np.testing.assert_allclose(left / scale, right / scale, rtol=1e-7, atol=1e-9)


def test_no_plans_are_made_ready():
    following = Following(Regulator(DOUBLE_INTEGRATOR, 0.02))
    plans, _ = random_plan(DOUBLE_INTEGRATOR, 2)
    assert len(following(plans[:0], np.zeros((0, 0)))) == 0


def test_a_copy_makes_the_same_of_plans():
    following, (plans, contexts) = Following(Regulator(PENDULUM, 0.02)), random_plan(PENDULUM, 3)
    expected = following(plans, contexts)
    copied = pickle.loads(pickle.dumps(following))
    np.testing.assert_array_equal(copied(plans, contexts).gains, expected.gains)
