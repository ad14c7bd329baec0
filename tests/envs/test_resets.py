"""The options of a reset: what is accepted, and what is refused with which answer."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from ocp_envs.envs.env import Env
from ocp_envs.envs.resets import due_rows, given_parameters
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problems.pendulum import PENDULUM
from tests.small_problems import WALLED_INTEGRATOR


@pytest.mark.parametrize(
    ("parameters", "error", "match"),
    [
        ([np.nan, 0.0], ValueError, "finite"),
        ([0.0], ValueError, r"expected parameters \(theta, omega\)"),
        ([7.0, 3.0], OutsideBoxError, "extrapolate=True"),
        ([[0.0, 0.0], [1.0, 0.0]], ValueError, "one episode, got 2"),
    ],
)
def test_refuses_bad_parameters_of_one_episode(parameters, error, match):
    with pytest.raises(error, match=match):
        Env(PENDULUM).reset(options={"parameters": parameters})


def test_refuses_mistyped_options():
    with pytest.raises(ValueError, match=r"unknown option 'params' of reset.* did you mean 'parameters'"):
        Env(PENDULUM).reset(options={"params": [0.0, 0.0]})


def test_extrapolates_only_within_the_operating_box():
    env = Env(PENDULUM)
    env.reset(options={"parameters": [7.0, 3.0], "extrapolate": True})
    assert env.state.tolist() == [7.0, 3.0]
    with pytest.raises(ValueError, match="outside the operating box"):
        env.reset(options={"parameters": [7.0, 50.0], "extrapolate": True})


def test_an_episode_begins_in_the_turn_in_which_its_angles_are_written():
    env = Env(PENDULUM)
    for theta in (1.0, 1.0 + 2 * np.pi, 1.0 - 4 * np.pi):
        env.reset(options={"parameters": [theta, 0.0]})
        assert env.state[0] == theta
    with pytest.raises(ValueError, match="outside the operating box"):
        env.reset(options={"parameters": [1.0 + 20 * np.pi, 0.0]})


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"parameters": np.zeros((2, 2))}, ValueError, "1 or 3 rows, got 2"),
        ({"parameters": np.full((3, 2), np.nan)}, ValueError, "finite"),
        ({"parameters": [-1.0, 3.0]}, OutsideBoxError, "extrapolate=True"),
        ({"parameter": [0.0, 0.0]}, ValueError, r"unknown option 'parameter' .* did you mean 'parameters'"),
        ({"reset_mask": np.array([1, 0, 1])}, ValueError, "boolean array"),
        ({"reset_mask": np.zeros(3, bool)}, ValueError, "at least one True"),
        ({"reset_mask": np.array([True, False, True])}, ResetNeeded, "first reset"),
    ],
)
def test_refuses_bad_options_of_many_episodes(options, error, match):
    with pytest.raises(error, match=match):
        VectorEnv(PENDULUM, 3).reset(options=options)


def test_a_mask_selects_the_rows_and_their_parameters():
    p = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]])
    mask = np.array([True, False, True])
    envs = VectorEnv(PENDULUM, 3)
    envs.reset(options={"parameters": p})
    envs.reset(options={"parameters": p + 0.1, "reset_mask": mask})
    np.testing.assert_array_equal(envs.parameters, p + 0.1 * mask[:, None])
    envs.reset(options={"parameters": p[1], "reset_mask": mask})
    np.testing.assert_array_equal(envs.parameters, [p[1], p[1], p[1]])
    np.testing.assert_array_equal(due_rows(PENDULUM, {"reset_mask": mask}, 3), [0, 2])
    np.testing.assert_array_equal(due_rows(PENDULUM, {}, 3), [0, 1, 2])


@pytest.mark.parametrize("parameters", [[[1.0, 1.05]], [[1.0, 3.0], [1.0, 1.05]]], ids=["one", "second of two"])
def test_refuses_an_initial_state_that_violates_a_constraint(parameters):
    with pytest.raises(ValueError, match=r"\(row \d\) begin where no episode can: clearance 0 is -0.05, .* knot 0"):
        given_parameters(WALLED_INTEGRATOR, {"parameters": parameters}, len(parameters))
