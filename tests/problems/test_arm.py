"""The arm against Lagrange's equations, formed by automatic differentiation of its energy, and against its geometry."""

import casadi as ca
import numpy as np
import pytest

import ocp_envs
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problems.arm import CONSTANTS, TWO_LINK_ARM, joints

ROWS = 50
RNG = np.random.default_rng(2)


def kinetic_energy(q, w):
    """½ Σ m ‖v_c‖² + ½ I ω² of two uniform rods with the angles ``q`` and rates ``w``."""
    (m1, m2), (l1, l2) = ([CONSTANTS[f"{name}_{i}"] for i in (1, 2)] for name in ("mass", "length"))
    absolute = [q[0], q[0] + q[1]]
    elbow = l1 * ca.vertcat(ca.cos(absolute[0]), ca.sin(absolute[0]))
    middles = elbow / 2, elbow + l2 / 2 * ca.vertcat(ca.cos(absolute[1]), ca.sin(absolute[1]))
    energy = m1 * l1**2 / 24 * w[0] ** 2 + m2 * l2**2 / 24 * (w[0] + w[1]) ** 2
    for mass, middle in zip((m1, m2), middles):
        energy += mass / 2 * ca.sumsqr(ca.mtimes(ca.jacobian(middle, q), w))
    return energy


def test_motions_obey_lagranges_equations():
    q, w, torque = ca.SX.sym("q", 2), ca.SX.sym("w", 2), ca.SX.sym("torque", 2)
    energy = kinetic_energy(q, w)
    momentum = ca.gradient(energy, w)
    forces = torque + ca.gradient(energy, q) - ca.mtimes(ca.jacobian(momentum, q), w)
    expected = ca.Function("acceleration", [q, w, torque], [ca.solve(ca.jacobian(momentum, w), forces)])
    box = TWO_LINK_ARM.system.state
    x = RNG.uniform(box.lower, box.upper, (ROWS, 4))
    u, contexts = RNG.uniform(-5, 5, (ROWS, 2)), np.tile([1.0, 0.0], (ROWS, 1))
    rate, cost = TWO_LINK_ARM.functions.rate()(x, u, contexts)
    rows = [np.array(expected(row[:2], row[2:], torques)).ravel() for row, torques in zip(x, u)]
    np.testing.assert_allclose(rate, np.concatenate([x[:, 2:], rows], axis=1), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(cost.ravel(), 1 + 0.02 * (u[:, 0] ** 2 + 4 * u[:, 1] ** 2))


def test_without_torque_the_energy_stays():
    q, w = ca.SX.sym("q", 2), ca.SX.sym("w", 2)
    energy = ca.Function("energy", [q, w], [kinetic_energy(q, w)])
    x, contexts = np.array([[0.3, 1.0, 1.5, -2.0]]), np.array([[1.0, 0.0]])
    before = float(energy(x[0, :2], x[0, 2:]))
    simulator = Simulator(TWO_LINK_ARM, 0.02)
    for _ in range(50):
        x = simulator.advance(x, np.zeros((1, 2)), contexts).states
    assert float(energy(x[0, :2], x[0, 2:])) == pytest.approx(before, rel=1e-5)


def test_in_both_postures_the_hand_is_at_the_point():
    p = ocp_envs.sample(TWO_LINK_ARM, seed=4, n=ROWS)
    targets = TWO_LINK_ARM.terminal.nearest(*TWO_LINK_ARM.start(p))
    points = p[:, 1:2] * np.stack([np.cos(p[:, 2]), np.sin(p[:, 2])], axis=1)
    for rows, point in zip(targets, points):
        np.testing.assert_allclose([joints(row)[2] for row in rows], np.tile(point, (len(rows), 1)), atol=1e-12)
        assert {-1.0, 1.0} == set(np.sign(rows[:, 1]))


def test_the_cheaper_posture_changes_with_the_side_of_the_target():
    left, right = (ocp_envs.solve(TWO_LINK_ARM, [0.0, 1.0, bearing]) for bearing in (0.8, -0.8))
    assert left.cost == pytest.approx(right.cost, rel=1e-6)  # mirror images
    assert np.sign(left.trajectory.states[0, -1, 1]) == -np.sign(right.trajectory.states[0, -1, 1]) != 0
