"""Declarations that cannot work are refused when they are made, in the words of the field; doubtful ones warn."""

import dataclasses
import pickle
import time
import warnings

import casadi as ca
import numpy as np
import pytest

from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.system import Box, Coordinate
from tests.declaration.strange import STRANGE
from tests.small_problems import DOUBLE_INTEGRATOR


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("case", STRANGE, ids=lambda case: case.what)
def test_strange_declarations_are_refused_by_name(case):
    with pytest.raises((ValueError, TypeError), match=case.words):
        case.declare()


@pytest.mark.parametrize("problem", [*BENCHMARK, DOUBLE_INTEGRATOR], ids=lambda problem: problem.id)
def test_declarations_that_work_do_not_warn_and_cost_little(problem):
    took = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(3):
            began = time.process_time()
            dataclasses.replace(problem)
            took.append(time.process_time() - began)
    assert min(took) < 0.05


def test_constants_that_nothing_reads_are_told():
    system = dataclasses.replace(PENDULUM.system, constants={**PENDULUM.system.constants, "friction": 0.1})
    with pytest.warns(UserWarning, match=r"reads the constants \['friction'\]"):
        dataclasses.replace(PENDULUM, system=system)


def test_functions_that_are_not_finite_in_a_part_of_the_box_are_told_with_a_point():
    with pytest.warns(UserWarning, match=r"cost_rate is not finite at \d of 8 points in the box, such as theta ="):
        dataclasses.replace(PENDULUM, cost_rate=lambda x, u, s, c: ca.sqrt(3 - x[1]))


def lifted(lower, upper):
    mass = Coordinate("mass", lower, upper, "kg")
    return dataclasses.replace(QUADCOPTER, parameters=Box((*QUADCOPTER.parameters.coordinates, mass)), symmetry=None)


def test_a_goal_that_is_an_equilibrium_for_some_parameters_alone_is_told():
    with pytest.warns(UserWarning, match=r"only in some contexts; .*mass = .*derivative of 'vz'"):
        lifted(0.4, 0.6)
    with pytest.raises(ValueError, match=r"hold = 5 s of terminal regulation needs a goal that is an equilibrium"):
        lifted(0.6, 0.8)


def test_a_plant_need_not_rest_at_the_goal_but_has_to_be_finite():
    plant = QUADCOPTER.with_constants(mass=0.6)
    rate, _ = plant.functions.rate()(np.zeros((1, 12)), QUADCOPTER.goal.control[None], np.zeros((1, 0)))
    assert rate[0, 5] == pytest.approx(9.81 * (0.5 / 0.6 - 1))
    assert plant.fingerprint != QUADCOPTER.fingerprint
    with pytest.raises(ValueError, match="'vx' is nan at the goal"):
        QUADCOPTER.with_constants(mass=0.0)


def test_a_constant_that_is_a_parameter_has_no_other_value():
    problem = dataclasses.replace(
        PENDULUM, parameters=Box((*PENDULUM.parameters.coordinates, Coordinate("mass", 0.5, 2.0, "kg")))
    )
    with pytest.raises(ValueError, match=r"the constants \['mass'\] are parameters of this problem"):
        problem.with_constants(mass=4.0)
    assert problem.with_constants(gravity=2.0).system.constants["gravity"] == 2.0


def test_what_was_checked_is_not_checked_again_after_a_pickle():
    plant = pickle.loads(pickle.dumps(QUADCOPTER.with_constants(mass=0.6)))
    assert plant.system.constants["mass"] == 0.6
    assert plant.fingerprint == QUADCOPTER.with_constants(mass=0.6).fingerprint
