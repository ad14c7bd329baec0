"""Perturbations of the plant: what they tell the environments, and which are refused."""

import dataclasses

import numpy as np
import pytest

from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.perturbations import Perturbation, mismatch
from moe_policy.rollouts.environments import environments
from ocp_envs.envs.options import EnvOptions
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.system import Box, Coordinate
from tests.small_problems import DOUBLE_INTEGRATOR


def of(problem, name):
    return next(perturbation for perturbation in benchmark_of(problem).perturbations if perturbation.name == name)


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_every_level_is_accepted_by_the_environments(problem):
    for perturbation in benchmark_of(problem).perturbations:
        for level in perturbation.levels:
            options = EnvOptions(problem, **perturbation.arguments(problem, level))
            changed = bool(options.constants) or options.disturbed or options.noisy or options.delay > 0
            assert changed == (level != 0)


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_the_plant_has_the_constants_and_the_planner_the_nominal_ones(problem):
    for perturbation in benchmark_of(problem).perturbations:
        if perturbation.kind != "mismatch":
            continue
        for level in (0.0, perturbation.levels[-1]):
            envs = environments(problem, 1, 0.02, **perturbation.arguments(problem, level))
            expected = dict(problem.system.constants)
            for name in perturbation.names:
                expected[name] *= 1 + level / 100
            for name in perturbation.divided:
                expected[name] /= 1 + level / 100
            assert envs.unwrapped.options.simulator.problem.system.constants == pytest.approx(expected)
            assert envs.unwrapped.problem is problem
            envs.close()


def rates(problem, perturbation, level, controls=1.0):
    """ẋ at random states of the perturbed plant, the controls times a factor."""
    rng = np.random.default_rng(0)
    draws = [box.lower + rng.random((50, len(box))) * (box.upper - box.lower) for box in boxes(problem)]
    constants = perturbation.arguments(problem, level).get("constants", {})
    states, inputs, contexts = draws
    return problem.with_constants(**constants).functions.rate()(states, controls * inputs, contexts)[0]


def boxes(problem):
    return problem.system.state, problem.system.control, problem.context


@pytest.mark.parametrize("problem", [QUADCOPTER, QUADCOPTER_OBSTACLE], ids=lambda problem: problem.id)
def test_a_thrust_gain_is_a_factor_of_the_controls(problem):
    thrust = of(problem, "thrust")
    np.testing.assert_allclose(rates(problem, thrust, 20.0), rates(problem, thrust, 0.0, 1.2), rtol=1e-12)


def test_a_torque_gain_is_a_factor_of_the_control():
    torque = of(PENDULUM, "torque")
    np.testing.assert_allclose(rates(PENDULUM, torque, -30.0), rates(PENDULUM, torque, 0.0, 0.7), rtol=1e-12)


def test_a_pendulum_twice_as_heavy_has_half_the_torque():
    mass, torque = of(PENDULUM, "mass"), of(PENDULUM, "torque")
    np.testing.assert_allclose(rates(PENDULUM, mass, 100.0), rates(PENDULUM, torque, -50.0), rtol=1e-12)


def test_inertia_divides_accelerations():
    """The pendulum's under all torques; the quadcopter's under those of its rotors, not under the gyroscopic ones."""
    inertia = of(PENDULUM, "inertia")
    nominal, heavy = (rates(PENDULUM, inertia, level) for level in (0.0, 25.0))
    np.testing.assert_allclose(1.25 * heavy[:, 1], nominal[:, 1], rtol=1e-12)
    inertia = of(QUADCOPTER, "inertia")
    nominal, heavy = rates(QUADCOPTER, inertia, 0.0), rates(QUADCOPTER, inertia, 25.0, 1.25)
    np.testing.assert_allclose(heavy[:, 9:], nominal[:, 9:], rtol=1e-9, atol=1e-9)
    assert not np.allclose(heavy[:, 3:6], nominal[:, 3:6])


def test_only_the_velocity_is_disturbed_and_noise_follows_the_scales():
    np.testing.assert_array_equal(of(PENDULUM, "disturbance").arguments(PENDULUM, 0.5)["disturbance"], [0.0, 0.5])
    for problem in BENCHMARK:
        disturbance = of(problem, "disturbance")
        units = {c.unit for c in problem.system.state.coordinates if c.name in disturbance.names}
        assert {f"{unit}²" for unit in units} == {disturbance.unit}
    noise = of(PENDULUM, "noise").arguments(PENDULUM, 10.0)["observation_noise"]
    np.testing.assert_allclose(noise, 0.1 * PENDULUM.system.state.scale)


def test_delays_are_whole_control_steps():
    delay = of(PENDULUM, "delay")
    assert delay.arguments(PENDULUM, 60.0, 0.02) == {"delay": 3}
    assert delay.arguments(PENDULUM, 60.0, 0.01) == {"delay": 6}
    with pytest.raises(ValueError, match="a multiple of the control period of 50 ms, got 60 ms"):
        delay.arguments(PENDULUM, 60.0, 0.05)


def test_a_problem_of_the_user_has_perturbations():
    names = {perturbation.name for perturbation in benchmark_of(DOUBLE_INTEGRATOR).perturbations}
    assert names == {*DOUBLE_INTEGRATOR.system.constants, "noise", "delay"}


def test_parameters_are_no_mismatch():
    mass = Coordinate("mass", 0.5, 2.0, "kg")
    problem = dataclasses.replace(DOUBLE_INTEGRATOR, parameters=Box((*DOUBLE_INTEGRATOR.parameters.coordinates, mass)))
    assert {perturbation.name for perturbation in benchmark_of(problem).perturbations} == {"noise", "delay"}
    with pytest.raises(ValueError, match=r"\['mass'\] are parameters, known to every planner"):
        mismatch("mass", "mass").arguments(problem, 10.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "magic"}, "expected a kind of"),
        ({"levels": (10.0, 20.0)}, "with 0 among them"),
        ({"levels": (0.0, 20.0, 10.0)}, "expected increasing levels"),
        ({"levels": (-100.0, 0.0)}, "expected levels above -100 %"),
        ({"levels": (-1.0, 0.0), "kind": "noise"}, "expected levels of 0 or more"),
    ],
)
def test_bad_perturbations_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(of(PENDULUM, "mass"), **change)


@pytest.mark.parametrize("level", [0.0, 1.0])
@pytest.mark.parametrize("part", ["names", "divided"])
def test_unknown_constants_are_refused(level, part):
    colour = Perturbation("colour", "colour", "%", "mismatch", (0.0, 1.0), **{part: ("colour",)})
    with pytest.raises(ValueError, match=r"has no \['colour'\]; there are \['gravity', 'length'"):
        colour.arguments(PENDULUM, level)
