"""A policy in C does what it does in Python."""

import itertools
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import moe_policy
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.speed.exports import Exported
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts, SingleNetwork, Softmax, outputs_of
from moe_policy.planners.scaling import Standardizer
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support.compiler import find_compiler
from tests.small_problems import WALLED_INTEGRATOR

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
EXACT = {"rtol": 1e-9, "atol": 1e-9}


def small(problem, mixing=None, seed=0):
    """A planner with random weights, whose plans are all over the boxes: a single network, or a mixture of two."""
    rng, ins, outs = np.random.default_rng(seed), len(problem.parameters), problem.flat_size

    def network(*sizes):
        weights = tuple(rng.normal(0, 1 / np.sqrt(n), (m, n)) for n, m in itertools.pairwise(sizes))
        return SingleNetwork(weights, tuple(rng.normal(0, 0.1, m) for m in sizes[1:]))

    single = network(ins, 7, 5, outs)
    net = single if mixing is None else MixtureOfExperts(network(ins, 3, 2), (single, network(ins, 4, outs)))
    knots, system, middle = problem.knots, problem.system, np.mean(problem.duration)
    mean = np.r_[np.tile(system.state.centre, knots), np.tile(system.control.centre, knots - 1), middle]
    std = np.r_[np.tile(system.state.width / 8, knots), np.tile(system.control.width / 2, knots - 1), middle / 2]
    inputs = Standardizer(problem.parameters.centre, problem.parameters.width)
    return NetworkPlanner(problem, "small", net, inputs, Standardizer(mean, std), *([] if mixing is None else [mixing]))


PLANNERS = {
    "pendulum, mixture": lambda: moe_policy.load(PENDULUM, "moe-custom"),
    "vehicle, single network": lambda: moe_policy.load(VEHICLE, "snn"),
    "vehicle, mixture": lambda: small(VEHICLE, moe_policy.Argmax()),
    "pendulum, softmax": lambda: small(PENDULUM, Softmax(0.3)),
    "with a context": lambda: small(WALLED_INTEGRATOR),
}


@pytest.fixture(scope="module", params=PLANNERS, ids=str)
def both(request, tmp_path_factory):
    """A policy in Python and in C."""
    policy = TrackingPolicy((planner := PLANNERS[request.param]()).problem, planner)
    folder = tmp_path_factory.mktemp("exported") / "new folder"
    return policy, Exported(policy, folder, ("-std=c99", "-pedantic-errors", "-O1"))


def parameters(problem, size=12):
    """Parameters in the box, outside of it, and with angles in another turn."""
    rng, box = np.random.default_rng(1), problem.parameters
    p = box.centre + rng.uniform(-0.7, 0.7, (size, len(box))) * box.width
    return np.concatenate([p, p[:4] + 3 * problem.parametrisation.turn[0], [box.lower, box.upper]])


def in_double(planner, p):
    """The planner's plan (1, flat_size) for ``p`` (np,), but with a network that calculates in double precision."""
    within, turns = planner.problem.in_one_turn(p)
    outputs = outputs_of(planner.network, planner.inputs.scale(within), planner.mixing)
    return planner.problem.unflatten(planner.outputs.unscale(outputs)).shifted(turns)


@needs_compiler
def test_plans_are_those_of_the_network(both):
    policy, exported = both
    p, scale = parameters(policy.problem), policy.planner.outputs.std
    found = np.array([exported.plan(row) for row in p])
    exact = np.concatenate([in_double(policy.planner, row).flat() for row in p])
    single = isinstance(policy.planner.mixing, Softmax)  # the probabilities are in single precision
    np.testing.assert_allclose(found / scale, exact / scale, rtol=0, atol=1e-6 if single else 1e-9)
    np.testing.assert_allclose(found / scale, policy.planner(p).flat() / scale, rtol=0, atol=1e-4)


@needs_compiler
def test_regulators_and_control_steps_are_those_of_the_policy(both):
    policy, exported = both
    problem, rng = policy.problem, np.random.default_rng(2)
    for p in parameters(problem):
        plan, (_, context) = in_double(policy.planner, p), problem.start(p[None])
        tracking = policy.follow(plan, context)
        exported.follow(plan.flat()[0], p)
        state, length = exported.state, tracking.states.shape[1]
        assert state["steps"] == round(float(tracking.schedule.plan_end[0]) / policy.dt)
        assert (state["clipped"], state["rejected"]) == (tracking.schedule.clipped, tracking.schedule.rejected)
        for name in ("states", "controls", "gains", "norms"):
            own = getattr(tracking, name)[0]
            np.testing.assert_allclose(state[name][:length], own, rtol=1e-8, atol=1e-9 * np.abs(own).max())
        seen = np.concatenate([problem.system.state.draw(rng, length + 2), np.tile(context, (length + 2, 1))], axis=1)
        for observation in seen:
            wanted, tracking = policy.act(observation[None], tracking, np.zeros(1, bool))
            np.testing.assert_allclose(exported.act(observation), wanted[0], **EXACT)


@needs_compiler
def test_an_episode_begins_with_a_plan_and_a_wild_plan_is_rejected(both):
    policy, exported = both
    p = policy.problem.parameters.centre
    exported.start(p)
    by_start = exported.state.copy()
    exported.follow(exported.plan(p), p)
    assert by_start == exported.state
    exported.follow(np.full(policy.problem.flat_size, np.nan), p)
    assert (exported.state["steps"], exported.state["rejected"], exported.state["clipped"]) == (0, 1, 0)
    np.testing.assert_array_equal(exported.state["states"][0], policy.problem.goal.state)


def test_nothing_is_allocated(tmp_path):
    text = TrackingPolicy(PENDULUM, small(PENDULUM)).to_c(tmp_path).read_text()
    assert not any(name in text for name in ("malloc", "calloc", "realloc", "alloca"))


def test_the_header_names_coordinates_with_their_units(tmp_path):
    path = TrackingPolicy(WALLED_INTEGRATOR, small(WALLED_INTEGRATOR), dt=0.05).to_c(tmp_path, "wall_1")
    header = path.with_suffix(".h").read_text()
    assert "observation  x [m], v [m/s], wall [m]" in header
    assert "A control step takes 0.05 s" in header
    assert "WALL_1_PARAMETERS = 2" in header
    assert "@" not in header


@pytest.mark.parametrize("name", ["", "1st", "a-b", "a b", "ä"])
def test_names_that_c_does_not_have_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match="expected a name of C"):
        TrackingPolicy(PENDULUM, small(PENDULUM)).to_c(tmp_path, name)


def test_other_planners_than_networks_are_refused(tmp_path):
    with pytest.raises(TypeError, match="planner is a NetworkPlanner, got"):
        TrackingPolicy(QUADCOPTER, moe_policy.load(QUADCOPTER, "nearest")).to_c(tmp_path)
    assert not list(tmp_path.iterdir())


@needs_compiler
def test_the_program_of_the_page_compiles_and_controls(tmp_path):
    page = (Path(__file__).resolve().parents[2] / "docs" / "deploy.md").read_text()
    (program,) = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    policy = TrackingPolicy(PENDULUM, moe_policy.load(PENDULUM, "moe-custom"))
    source, main = policy.to_c(tmp_path), tmp_path / "main.c"
    main.write_text(program)
    warnings = ["-std=c99", "-Wall", "-Werror"]
    subprocess.run([find_compiler(), *warnings, main, source, "-o", tmp_path / "main", "-lm"], check=True)
    printed = subprocess.run([tmp_path / "main"], check=True, capture_output=True, text=True).stdout
    seen, state, expected = np.array([[0.5, 0.0]]), policy.start([0.5, 0.0]), []
    for _ in range(5):
        control, state = policy.act(seen, state, np.zeros(1, bool))
        expected.append(control[0, 0])
    np.testing.assert_allclose([float(line) for line in printed.split()], expected, atol=1e-4)
