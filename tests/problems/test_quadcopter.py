"""The quadcopter against rigid-body mechanics written down another way, and the modes of the obstacle problem."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocp_envs.envs.simulation import Simulator
from ocp_envs.problems.quadcopter import CONSTANTS, HOVER_THRUST, QUADCOPTER, QUADCOPTER_OBSTACLE, contact
from ocp_envs.solvers.accuracy import integrate
from ocp_envs.trajectory import Trajectory

ROWS = 200
INERTIA = np.array([CONSTANTS["inertia_x"], CONSTANTS["inertia_y"], CONSTANTS["inertia_z"]])
NO_CONTEXT = np.empty((ROWS, 0))


def draw(rows=ROWS, share=1.0, seed=0):
    """States and controls in the middle ``share`` of their boxes."""
    rng = np.random.default_rng(seed)
    boxes = QUADCOPTER.system.state, QUADCOPTER.system.control
    centres = [box.centre for box in boxes]
    return [
        centre + share * (box.upper - centre) * rng.uniform(-1, 1, (rows, len(box)))
        for box, centre in zip(boxes, centres)
    ]


def attitude(x):
    """Rotation from body to world: yaw ψ, then roll φ, then pitch θ, each about the axis as turned so far."""
    phi, theta, psi = x[..., 6], x[..., 7], x[..., 8]
    return Rotation.from_euler("ZXY", np.stack([psi, phi, theta], axis=-1))


def angle_rates(x):
    """(φ̇, θ̇, ψ̇) from R⁻¹Ṙ = [ω]×, where each angle turns about an axis that is known in the body."""
    pitch = Rotation.from_euler("Y", x[:, 7:8])
    roll_pitch = Rotation.from_euler("XY", x[:, 6:8])
    roll_axis = pitch.inv().apply(np.tile([1.0, 0, 0], (len(x), 1)))
    pitch_axis = np.tile([0.0, 1, 0], (len(x), 1))
    yaw_axis = roll_pitch.inv().apply(np.tile([0.0, 0, 1], (len(x), 1)))
    axes = np.stack([roll_axis, pitch_axis, yaw_axis], axis=2)
    return np.linalg.solve(axes, x[:, 9:, None])[:, :, 0]


def rigid_body(x, u):
    """Newton and Euler: m v̇ = R (0, 0, T) − m g e_z, I ω̇ = τ − ω × I ω."""
    arm, k = CONSTANTS["arm"], CONSTANTS["moment_ratio"]
    rotors = np.array([[arm, 0, 0], [0, arm, 0], [-arm, 0, 0], [0, -arm, 0]])  # along x, y, −x, −y
    up = np.array([0.0, 0, 1])
    spin = np.array([1, -1, 1, -1])  # of the drag on the body
    force = u.sum(axis=1)[:, None] * up
    torque = np.cross(rotors[None], u[:, :, None] * up).sum(axis=1) + (k * u @ spin)[:, None] * up
    acceleration = attitude(x).apply(force) / CONSTANTS["mass"] - CONSTANTS["gravity"] * up
    turn = (torque - np.cross(x[:, 9:], INERTIA * x[:, 9:])) / INERTIA
    return np.concatenate([x[:, 3:6], acceleration, angle_rates(x), turn], axis=1)


def test_right_hand_side_is_that_of_a_rigid_body():
    x, u = draw()
    rate, cost = QUADCOPTER.functions.rate()(x, u, NO_CONTEXT)
    np.testing.assert_allclose(rate, rigid_body(x, u), rtol=1e-10, atol=1e-10)
    weights = np.repeat([0, 1, 0.1, 1], 3)
    np.testing.assert_allclose(cost[:, 0], 10 + (weights * x**2).sum(axis=1) + (u**2).sum(axis=1), rtol=1e-12)


def test_angle_rates_are_those_of_the_turning_body():
    """Independent of the axes above: R(t + h) ≈ R(t) exp([ω] h)."""
    x, u = draw(share=0.7)
    rate, _ = QUADCOPTER.functions.rate()(x, u, NO_CONTEXT)
    h = 1e-6
    later, earlier = x.copy(), x.copy()
    later[:, 6:9] += h / 2 * rate[:, 6:9]
    earlier[:, 6:9] -= h / 2 * rate[:, 6:9]
    turned = (attitude(earlier).inv() * attitude(later)).as_rotvec() / h
    np.testing.assert_allclose(turned, x[:, 9:], atol=1e-7)


def test_free_fall_is_a_parabola_and_keeps_spin_and_energy():
    x, _ = draw(share=0.15)
    x[:, 6:9] *= 0.5
    seconds, still = 0.5, np.zeros((ROWS, 4))
    end, _ = QUADCOPTER.functions.flow(200)(x, still, NO_CONTEXT, np.full((ROWS, 1), seconds))
    gravity = np.array([0, 0, -CONSTANTS["gravity"]])
    np.testing.assert_allclose(end[:, :3], x[:, :3] + seconds * x[:, 3:6] + seconds**2 / 2 * gravity, atol=1e-10)
    np.testing.assert_allclose(end[:, 3:6], x[:, 3:6] + seconds * gravity, atol=1e-10)
    spins = [attitude(y).apply(INERTIA * y[:, 9:]) for y in (x, end)]
    assert np.abs(end[:, 6:9] - x[:, 6:9]).max() > 0.3  # it does turn
    np.testing.assert_allclose(spins[1], spins[0], atol=1e-10)
    energies = [(INERTIA * y[:, 9:] ** 2).sum(axis=1) for y in (x, end)]
    np.testing.assert_allclose(energies[1], energies[0], atol=1e-10)


def test_turning_the_world_about_the_vertical_turns_the_motion():
    x, u = draw(share=0.4)
    angle = 0.7
    turn = Rotation.from_euler("Z", angle)

    def turned(y):
        z = y.copy()
        z[:, :3], z[:, 3:6] = turn.apply(y[:, :3]), turn.apply(y[:, 3:6])
        z[:, 8] += angle
        return z

    flow, h = QUADCOPTER.functions.flow(4), np.full((ROWS, 1), 0.1)
    np.testing.assert_allclose(
        flow(turned(x), u, NO_CONTEXT, h)[0], turned(flow(x, u, NO_CONTEXT, h)[0]), rtol=1e-10, atol=1e-10
    )


def test_linearisation_at_hover_is_the_textbook_one():
    """Small tilts accelerate sideways: v̇_x = g θ, v̇_y = −g φ; thrusts and torques are chains of integrators."""
    h = 1e-3
    hover = np.zeros((1, 12)), np.full((1, 4), HOVER_THRUST)
    a, b = QUADCOPTER.functions.linearisation(1)(*hover, np.empty((1, 0)), np.array([[h]]))
    slope = np.zeros((12, 12))
    slope[range(3), range(3, 6)] = slope[range(6, 9), range(9, 12)] = 1
    slope[3, 7], slope[4, 6] = CONSTANTS["gravity"], -CONSTANTS["gravity"]
    np.testing.assert_allclose((a[0] - np.eye(12)) / h, slope, atol=10 * h)
    arm, k, mass = CONSTANTS["arm"], CONSTANTS["moment_ratio"], CONSTANTS["mass"]
    effect = np.zeros((12, 4))
    effect[5] = 1 / mass
    effect[9, [1, 3]] = np.array([arm, -arm]) / INERTIA[0]
    effect[10, [2, 0]] = np.array([arm, -arm]) / INERTIA[1]
    effect[11] = np.array([k, -k, k, -k]) / INERTIA[2]
    np.testing.assert_allclose(b[0] / h, effect, atol=50 * h)


def test_linearisation_of_a_tick_agrees_with_finite_differences():
    x, u = draw(20, share=0.5)
    s, h, step, flow = np.empty((20, 0)), np.full((20, 1), 0.02), 1e-6, QUADCOPTER.functions.flow(2)
    a, b = QUADCOPTER.functions.linearisation(2)(x, u, s, h)
    for i, e in enumerate(step * np.eye(12)):
        np.testing.assert_allclose(a[:, :, i], (flow(x + e, u, s, h)[0] - flow(x - e, u, s, h)[0]) / 2e-6, atol=1e-6)
    for i, e in enumerate(step * np.eye(4)):
        np.testing.assert_allclose(b[:, :, i], (flow(x, u + e, s, h)[0] - flow(x, u - e, s, h)[0]) / 2e-6, atol=1e-6)


def test_a_tick_agrees_with_the_true_equation_and_converges_with_order_four():
    x, u = draw(share=2 / 3)
    true = integrate(QUADCOPTER.functions.rate(), x, u, NO_CONTEXT, np.full(ROWS, 0.02))
    steps = {n: Simulator(QUADCOPTER, 0.02, n).advance(x, u, NO_CONTEXT) for n in (1, 2, 4, 8)}
    stayed = ~steps[1].left_box  # the others are clipped
    assert stayed.sum() > ROWS / 2
    errors = {n: np.linalg.norm(step.states - true, axis=1)[stayed] for n, step in steps.items()}
    assert Simulator(QUADCOPTER, 0.02).substeps == 2
    assert errors[2].max() < 5e-6
    assert errors[1].max() > 1e-5  # why there are two
    orders = [np.log2(np.median(errors[n]) / np.median(errors[2 * n])) for n in (1, 2, 4)]
    np.testing.assert_allclose(orders, 4, atol=0.2)


# -- the obstacle ------------------------------------------------------------------------------------------------------

KNOTS = QUADCOPTER_OBSTACLE.knots


def passing(points, centre, radius=2.0):
    """One trajectory through ``points`` (KNOTS, 3), with the parameters that put a sphere there."""
    states = np.zeros((1, KNOTS, 12))
    states[0, :, :3] = points
    trajectory = Trajectory(states, np.full((1, KNOTS - 1, 4), HOVER_THRUST), np.ones(1))
    return np.array([[*points[0], *centre, radius]]), trajectory


def test_the_contact_is_the_mean_over_active_knots_by_multiplier():
    points = np.zeros((KNOTS, 3))
    points[5], points[6], points[7] = [3, 0, 1], [3, 2, 1], [9, 9, 9]
    p, trajectory = passing(points, [1.0, 1.0, 1.0])
    multipliers = np.zeros((1, KNOTS, 1))
    multipliers[0, [5, 6, 7], 0] = 3.0, 1.0, 0.9e-6 * 3
    expected = (3 * np.array([2, -1, 0]) + np.array([2, 1, 0])) / 4
    np.testing.assert_allclose(contact(QUADCOPTER_OBSTACLE, p, trajectory, multipliers), [expected], atol=1e-12)
    mode = QUADCOPTER_OBSTACLE.modes.classify(QUADCOPTER_OBSTACLE, p, trajectory, multipliers)
    assert [QUADCOPTER_OBSTACLE.modes.names[m] for m in mode] == ["+-+"]  # a zero counts as positive


@pytest.mark.parametrize("rest", [0.0, 9e-5])
def test_where_nothing_is_active_the_closest_knot_counts(rest):
    points = np.linspace([8.0, 8, 8], [0, 0, 0], KNOTS)
    points[11] = [3.0, 4.0, 5.0]
    p, trajectory = passing(points, [3.5, 3.5, 5.5])
    multipliers = np.full((1, KNOTS, 1), rest) * np.linspace(0.1, 1, KNOTS)[None, :, None]
    np.testing.assert_allclose(contact(QUADCOPTER_OBSTACLE, p, trajectory, multipliers), [[-0.5, 0.5, -0.5]])


def test_every_sign_has_its_mode():
    assert len(set(QUADCOPTER_OBSTACLE.modes.names)) == 8
    for name in QUADCOPTER_OBSTACLE.modes.names:
        side = np.array([1.0 if sign == "+" else -1.0 for sign in name])
        p, trajectory = passing(np.tile(side, (KNOTS, 1)), np.zeros(3))
        multipliers = np.ones((1, KNOTS, 1))
        mode = QUADCOPTER_OBSTACLE.modes.classify(QUADCOPTER_OBSTACLE, p, trajectory, multipliers)
        assert QUADCOPTER_OBSTACLE.modes.names[mode[0]] == name
