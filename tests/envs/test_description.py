"""The page of an environment is derived from the declaration, the environment's docstring and the module's."""

from __future__ import annotations

import dataclasses
import inspect

import numpy as np
import pytest

import ocp_envs
from ocp_envs.envs.description import background
from ocp_envs.envs.env import Env
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.rocket import ROCKET

each_problem = pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)


@each_problem
def test_a_page_has_the_source_of_its_problem(problem):
    assert "L = " in background(problem)
    assert background(problem) in ocp_envs.describe(problem)


def test_a_problem_of_the_user_has_no_source():
    mine = dataclasses.replace(PENDULUM, id="Mine-v0")
    assert background(mine) == ""
    assert "## Description\n\nSwing a torque-limited pendulum up and stop upright.\n\n##" in ocp_envs.describe(mine)


def test_every_argument_of_an_environment_is_listed_with_its_default():
    text = ocp_envs.describe(PENDULUM)
    for name, parameter in inspect.signature(Env).parameters.items():
        if parameter.default is not inspect.Parameter.empty:
            assert f"| `{name}` | `{parameter.default!r}` |" in text


def test_constraints_and_plans_are_described():
    text = ocp_envs.describe(ROCKET)
    assert "h ≥ 0" in text
    assert "thrust in [5.8, 12.4]" in text
    assert f"{ROCKET.flat_size} numbers" in text
    assert "The boxes of states and controls alone." in ocp_envs.describe(PENDULUM)
    assert "Box((2,), float32)" in ocp_envs.describe(PENDULUM)
    assert np.all([name in ocp_envs.describe(PENDULUM) for name in PENDULUM.modes.names])
