import dataclasses

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocp_envs.envs.description import describe
from ocp_envs.goal import Goal
from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import BENCHMARK, UnknownProblemError, load, names, register
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import HOVER_THRUST, QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.system import Box, Coordinate
from ocp_envs.trajectory import Trajectory

PROBLEMS = list(dict.fromkeys([*BENCHMARK, VEHICLE, QUADCOPTER, QUADCOPTER_OBSTACLE]))
every_problem = pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.id)


def draw(box: Box, size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(box.lower, box.upper, size=(size, len(box)))


@every_problem
def test_start_and_parameters_are_inverses(problem):
    p = draw(problem.parameters, 20)
    states, contexts = problem.start(p)
    assert states.shape == (20, problem.system.nx)
    assert contexts.shape == (20, len(problem.context))
    np.testing.assert_array_equal(problem.parameters_of(states, contexts), p)


@every_problem
def test_flat_trajectories_come_back(problem):
    z = np.random.default_rng(5).normal(size=(3, problem.flat_size))
    trajectory = problem.unflatten(z)
    assert trajectory.states.shape == (3, problem.knots, problem.system.nx)
    np.testing.assert_array_equal(trajectory.flat(), z)
    with pytest.raises(ValueError, match="flat trajectories"):
        problem.unflatten(z[:, :-1])


@every_problem
def test_the_goal_lies_within_the_boxes_and_is_an_equilibrium_where_it_is_a_single_state(problem):
    s = draw(problem.context, 1)
    x, u = problem.terminal.states(s), problem.terminal.controls(s)
    rate, _ = problem.functions.rate()(x, u, s)
    if problem.terminal.pinned:
        np.testing.assert_allclose(rate, 0, atol=1e-12)
    assert problem.system.state.contains(problem.targets).all()
    assert problem.system.control.contains(u).all()
    np.testing.assert_allclose(problem.goal_error(problem.targets), 0, atol=1e-12)


@every_problem
def test_starts_lie_in_the_operating_box(problem):
    corners = np.stack([problem.parameters.lower, problem.parameters.upper])
    assert problem.system.state.contains(problem.start(corners)[0]).all()


@every_problem
def test_linearisation_agrees_with_finite_differences(problem):
    system, size, eps = problem.system, 5, 1e-6
    x = draw(system.state, size, 1) * 0.5
    u, s = draw(system.control, size, 2), draw(problem.context, size, 3)
    h = np.full((size, 1), 0.05)
    flow = problem.functions.flow(2)
    a, b = problem.functions.linearisation(2)(x, u, s, h)
    for i in range(system.nx):
        e = eps * np.eye(system.nx)[i]
        np.testing.assert_allclose(
            a[:, :, i], (flow(x + e, u, s, h)[0] - flow(x - e, u, s, h)[0]) / (2 * eps), atol=2e-6
        )
    for i in range(system.nu):
        e = eps * np.eye(system.nu)[i]
        np.testing.assert_allclose(
            b[:, :, i], (flow(x, u + e, s, h)[0] - flow(x, u - e, s, h)[0]) / (2 * eps), atol=2e-6
        )


def test_fingerprints_are_those_that_databases_and_weights_carry():
    assert {problem.id: problem.fingerprint for problem in BENCHMARK} == {
        "PendulumSwingup-v0": "968598df5ecca2ca",
        "GroundVehicle-v0": "a27dea3719dfe9c1",
        "Quadcopter-v0": "cb67d9a03a497290",
        "QuadcopterObstacle-v0": "f78c6601fa8bed00",
        "PendulumUncertain-v0": "fcd961de4b149d19",
        "CartPoleSwingup-v0": "3d683e491833086c",
        "RocketLanding-v0": "7796fb5862a665b8",
        "TwoLinkArm-v0": "2febb934eafe11dd",
        "PlanarQuadcopterDiscs-v0": "8250696b75060c69",
        "QuadcopterRecovery-v0": "221fd4e955088872",
    }


@every_problem
def test_the_fingerprint_tells_problems_apart(problem):
    assert problem.fingerprint == dataclasses.replace(problem).fingerprint
    constant = next(name for name in problem.system.constants if name not in problem.context.names)
    others = [
        dataclasses.replace(problem, knots=problem.knots + 1),
        dataclasses.replace(problem, cost_rate=lambda x, u, s, c: problem.cost_rate(x, u, s, c) + 0.01),
        problem.with_constants(**{constant: 0.77}),
    ]
    assert len({problem.fingerprint, *(other.fingerprint for other in others)}) == 4


def test_the_cost_of_a_step_is_the_integral_of_the_cost_rate():
    # u constant, so ∫_0^h (1 + u²) dt = h (1 + u²) exactly
    u = np.array([[0.5]])
    _, cost = PENDULUM.functions.flow(1)(np.array([[1.0, 0.2]]), u, np.zeros((1, 0)), np.array([[0.3]]))
    assert cost[0, 0] == pytest.approx(0.3 * 1.25)


@given(st.floats(-3, 9), st.floats(-2, 2), st.floats(-1, 1))
def test_pendulum_point_reflection_about_upright(theta, omega, u):
    flow = PENDULUM.functions.flow(1)
    s, h = np.zeros((1, 0)), np.array([[0.1]])
    there, _ = flow(np.array([[theta, omega]]), np.array([[u]]), s, h)
    mirrored, _ = flow(np.array([[2 * np.pi - theta, -omega]]), np.array([[-u]]), s, h)
    np.testing.assert_allclose(mirrored, [[2 * np.pi, 0]] - there, atol=1e-9)


def test_quadcopter_falls_freely_and_hovers():
    rate = QUADCOPTER.functions.rate()
    x = np.zeros((1, 12))
    fall, _ = rate(x, np.zeros((1, 4)), np.zeros((1, 0)))
    np.testing.assert_allclose(fall[0], [0] * 5 + [-9.81] + [0] * 6, atol=1e-12)
    assert HOVER_THRUST == pytest.approx(0.5 * 9.81 / 4)


def test_a_parameter_named_like_a_constant_replaces_it():
    mass = Coordinate("mass", 0.5, 2.0, "kg")
    problem = dataclasses.replace(
        PENDULUM, id="Pendulum-mass", parameters=Box((*PENDULUM.parameters.coordinates, mass))
    )
    assert problem.context.names == ("mass",)
    x, u = np.array([[1.0, 0.0]]), np.array([[1.0]])
    rate, _ = problem.functions.rate()(x, u, np.array([[2.0]]))
    assert rate[0, 1] == pytest.approx(0.5 - np.sin(1.0))


def test_the_obstacle_is_context_and_clearance_is_the_distance_to_its_surface():
    p = np.array([[8.0, 8, 8, 4, 4, 4, 3]])
    states, contexts = QUADCOPTER_OBSTACLE.start(p)
    assert QUADCOPTER_OBSTACLE.context.names == ("cx", "cy", "cz", "radius")
    (clearance,) = QUADCOPTER_OBSTACLE.functions.clearances()(states, contexts)
    assert clearance[0, 0] == pytest.approx(np.sqrt(48) - 3)
    assert PENDULUM.n_clearances == 0
    assert PENDULUM.clearances(ca.SX.sym("x", 2), ca.SX.sym("s", 0)).shape == (0, 1)


def test_modes_of_the_pendulum_are_its_windings():
    knots = PENDULUM.knots
    states = np.zeros((3, knots, 2))
    states[:, -1, 0] = [-np.pi, np.pi + 1e-4, 3 * np.pi]
    trajectory = Trajectory(states, np.zeros((3, knots - 1, 1)), np.ones(3))
    p, multipliers = np.zeros((3, 2)), np.zeros((3, knots, 0))
    assert PENDULUM.modes.classify(PENDULUM, p, trajectory, multipliers).tolist() == [0, 1, 2]


@pytest.mark.parametrize("p", [[1.0], [1.0, 2.0, 3.0], [[[1.0, 2.0]]]])
def test_wrong_parameter_shapes_are_refused(p):
    with pytest.raises(ValueError, match=r"expected parameters \(theta, omega\)"):
        PENDULUM.check_parameters(p)


def test_parameters_outside_the_box_need_extrapolate_and_nan_never_passes():
    with pytest.raises(OutsideBoxError, match="extrapolate=True"):
        PENDULUM.check_parameters([1.0, 2.1])
    np.testing.assert_array_equal(PENDULUM.check_parameters([1.0, 2.1], extrapolate=True), [[1.0, 2.1]])
    assert PENDULUM.check_parameters([np.float32(2 * np.pi), 0.0]).shape == (1, 2)
    with pytest.raises(ValueError, match="finite; row 1"):
        PENDULUM.check_parameters([[1.0, 0.0], [np.nan, 0.0]], extrapolate=True)


def test_the_catalogue_suggests_the_nearest_name():
    with pytest.raises(UnknownProblemError, match="did you mean 'PendulumSwingup-v0'"):
        load("PendulumSwingUp-v1")
    assert "PendulumSwingup-v0" in names()
    with pytest.raises(ValueError, match="already registered"):
        register(dataclasses.replace(PENDULUM, knots=30))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal": Goal([np.pi], 0.1, [[0]], [0.0])}, "expected a goal"),
        ({"goal": Goal([np.pi, 0.0], 0.1, [[0, 1]], [0.0])}, "without a period"),
        ({"duration": (2.0, 1.0)}, "shortest ≤ longest"),
        ({"knots": 1}, "knots"),
        ({"rest": np.zeros(3)}, "rest"),
    ],
)
def test_parts_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(PENDULUM, **changes)


def test_a_goal_needs_a_radius():
    with pytest.raises(ValueError, match="radius"):
        Goal([0.0], 0.0, [[0]], [0.0])


@every_problem
def test_representations_fit_a_screen(problem):
    lines = repr(problem).splitlines()
    assert len(lines) == 3
    assert all(len(line) <= 240 for line in lines)
    assert f"{problem.id!r}, nx={problem.system.nx}, nu={problem.system.nu}, np={len(problem.parameters)}" in lines[0]
    assert all(name in lines[1] for name in problem.parameters.names)
    for part in (problem.system, problem.goal, problem.system.control):
        assert len(repr(part).splitlines()) == 1
        assert len(repr(part)) <= 240


def test_problems_are_values():
    assert isinstance(PENDULUM, OptimalControlProblem)
    with pytest.raises(dataclasses.FrozenInstanceError):
        PENDULUM.knots = 3


@given(st.floats(-3, 3), st.floats(-5, 5), st.floats(-5, 5))
def test_vehicle_mirror_and_reversal(theta, u_theta, u_v):
    flow = VEHICLE.functions.flow(1)
    s, h = np.zeros((1, 0)), np.array([[0.2]])
    x, u = np.array([[1.0, -2.0, theta, 1.5]]), np.array([[u_theta, u_v]])
    there, _ = flow(x, u, s, h)
    mirror, mirror_u = np.array([-1, 1, -1, 1]), np.array([-1, 1])  # left becomes right
    np.testing.assert_allclose(flow(x * mirror, u * mirror_u, s, h)[0], there * mirror, atol=1e-12)
    reverse, reverse_u = np.array([-1, -1, 1, -1]), np.array([-1, -1])  # front becomes back: the path turned by π
    np.testing.assert_allclose(flow(x * reverse, u * reverse_u, s, h)[0], there * reverse, atol=1e-12)


def test_modes_of_the_vehicle_are_winding_times_direction():
    states = np.zeros((4, VEHICLE.knots, 4))
    states[:, -1, 2] = [-2 * np.pi, 0, 0, 2 * np.pi]
    states[:, :, 3] = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    trajectory = Trajectory(states, np.zeros((4, VEHICLE.knots - 1, 2)), np.ones(4))
    p, multipliers = np.zeros((4, 4)), np.zeros((4, VEHICLE.knots, 0))
    assert VEHICLE.modes.classify(VEHICLE, p, trajectory, multipliers).tolist() == [1, 2, 3, 4]


def test_the_documentation_names_the_distribution():
    assert "by the parameter p, uniform, in the box" in describe(PENDULUM)
    text = describe(QUADCOPTER_OBSTACLE)
    assert "conditioned on the optimal trajectory of Quadcopter-v0 being blocked, in the box" in text
    assert "of the control step" in text
