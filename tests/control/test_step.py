"""The control step of tracking: the same in C and with NumPy, and no state that it could read past the end of."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from moe_policy.control.step import ControlStep, Tracking
from moe_policy.control.tracking import TrackingPolicy
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.support.compiler import find_compiler
from tests.plans import random_plan
from tests.small_problems import WALLED_INTEGRATOR


def tracked(problem, size=5, seed=0):
    """A policy, its recurrent state for random plans, and observations all over the boxes."""
    plans, contexts = random_plan(problem, size, seed)
    policy = TrackingPolicy(problem, lambda p: plans)
    boxes, rng = (problem.system.state, problem.context), np.random.default_rng(seed)
    return policy, policy.follow(plans, contexts), np.hstack([box.draw(rng, size) for box in boxes])


@pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
@pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable")
@pytest.mark.parametrize("problem", [*BENCHMARK, WALLED_INTEGRATOR], ids=lambda p: p.id)
def test_both_control_steps_are_the_same(problem, monkeypatch):
    policy, state, seen = tracked(problem)
    in_c = policy._step
    assert in_c._program is not None
    monkeypatch.setenv("CC", "none")
    with_numpy = ControlStep(problem, policy.regulator.substeps)
    seen[1, 0], scale = np.nan, problem.system.control.width
    for clock in (0, 7, 500):
        later = dataclasses.replace(state, clock=clock + np.arange(5))
        one, other = (step(seen, later) for step in (in_c, with_numpy))
        np.testing.assert_allclose(one / scale, other / scale, atol=1e-12)
        assert np.isnan(one).any(axis=1).tolist() == [False, True, False, False, False]
    assert with_numpy._program is None


def test_a_later_state_differs_in_its_clock_alone():
    _, state, _ = tracked(PENDULUM)
    later = state.later().later()
    assert (later.clock == 2).all()
    assert (state.clock == 0).all()
    assert later.gains is state.gains


@pytest.mark.parametrize("again", [copy.deepcopy, copy.copy, lambda state: pickle.loads(pickle.dumps(state))])
def test_copies_of_policies_and_states_act_alike(again):
    policy, state, seen = tracked(QUADCOPTER)
    _, state = policy.act(seen, state, np.zeros(5, bool))
    copied = again(state)
    expected, _ = policy.act(seen, state, np.zeros(5, bool))
    del state
    np.testing.assert_array_equal(again(policy._step)(seen, copied), expected)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("gains", lambda values: values[:, :-1]),
        ("norms", lambda values: values[..., :-1]),
        ("controls", lambda values: values[:, :, :-1]),
        ("clock", lambda values: values - 1),
    ],
)
def test_states_that_do_not_fit_together_are_refused(name, change):
    _, state, _ = tracked(QUADCOPTER)
    with pytest.raises(ValueError, match="Tracking: expected"):
        dataclasses.replace(state, **{name: change(getattr(state, name))})


def test_states_and_observations_of_others_are_refused():
    policy, state, seen = tracked(PENDULUM)
    _, other, wide = tracked(QUADCOPTER)
    for observations, recurrent in ((seen, other), (wide, state), (seen[:2], state)):
        with pytest.raises(ValueError, match="expected observations"):
            policy.act(observations, recurrent, np.zeros(len(observations), bool))


def test_arrays_of_any_layout_are_kept_as_the_program_needs_them():
    _, state, _ = tracked(PENDULUM)
    turned = dataclasses.replace(state, states=np.asfortranarray(state.states), clock=np.zeros(10, np.int32)[::2])
    assert turned.states.flags.c_contiguous
    assert turned.clock.dtype == np.int64
    assert isinstance(turned, Tracking)
