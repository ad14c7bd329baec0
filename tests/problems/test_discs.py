"""The planar quadcopter against the one in space, and the sides on which it passes the discs."""

import numpy as np

import ocp_envs
from ocp_envs.problems.discs import PLANAR_QUADCOPTER
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.trajectory import Trajectory


def test_it_moves_as_the_quadcopter_does_in_a_plane():
    rng = np.random.default_rng(5)
    x, u = rng.uniform(-1, 1, (30, 6)), rng.uniform(1, 4, (30, 2))
    flat, _ = PLANAR_QUADCOPTER.functions.rate()(x, u, np.tile(PLANAR_QUADCOPTER.context.centre, (30, 1)))
    # A pitch of −θ with the rotors 3 and 1 on either side, and half of the thrust of each pair on the axis of pitch.
    whole, thrusts = np.zeros((30, 12)), np.zeros((30, 4))
    whole[:, [0, 2, 3, 5]], whole[:, 7], whole[:, 10] = x[:, [0, 1, 3, 4]], -x[:, 2], -x[:, 5]
    thrusts[:, 0], thrusts[:, 2] = u[:, 1], u[:, 0]
    rate, _ = QUADCOPTER.functions.rate()(whole, thrusts, np.empty((30, 0)))
    np.testing.assert_allclose(flat[:, [0, 1, 3, 4]], rate[:, [0, 2, 3, 5]], atol=1e-12)
    np.testing.assert_allclose(flat[:, [2, 5]], -rate[:, [7, 10]], atol=1e-12)


def test_the_family_says_above_which_discs_a_path_passes():
    p = PLANAR_QUADCOPTER.parameters.centre[None]
    x = np.linspace(-8, 0, PLANAR_QUADCOPTER.knots)
    states = np.zeros((1, len(x), 6))
    states[0, :, 0], states[0, :, 1] = x, np.where(x < -5, 1.0, np.where(x < -3, -1.0, 1.0))
    path = Trajectory(states, np.zeros((1, len(x) - 1, 2)), np.array([3.0]))
    family = PLANAR_QUADCOPTER.modes.classify(PLANAR_QUADCOPTER, p, path, np.zeros((1, len(x), 3)))
    assert PLANAR_QUADCOPTER.modes.names[family[0]] == "+-+"


def test_a_disc_is_passed_on_its_free_side():
    for height, side in ((-1.0, "+"), (1.0, "-")):
        discs = [-6.0, -height * 1.5, 0.4, -4.0, height, 1.0, -2.0, height, 0.4]
        solution = ocp_envs.solve(PLANAR_QUADCOPTER, [0.0, *discs])
        assert PLANAR_QUADCOPTER.modes.names[solution.mode][1] == side
        assert (
            PLANAR_QUADCOPTER.functions.clearances()(
                solution.trajectory.states[0], np.tile(discs, (PLANAR_QUADCOPTER.knots, 1))
            )[0].min()
            > -1e-6
        )
