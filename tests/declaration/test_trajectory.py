import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.trajectory import Trajectory, flat_size
from tests.small_problems import with_states

SIZES = st.integers(1, 5)


def random_trajectory(seed, batch, knots, nx, nu):
    rng = np.random.default_rng(seed)
    return Trajectory(
        rng.normal(size=(batch, knots, nx)), rng.normal(size=(batch, knots - 1, nu)), rng.uniform(1, 2, size=batch)
    )


@given(st.integers(0, 100), st.integers(0, 4), st.integers(2, 6), SIZES, SIZES)
def test_flat_layout_round_trip(seed, batch, knots, nx, nu):
    trajectory = random_trajectory(seed, batch, knots, nx, nu)
    back = Trajectory.from_flat(trajectory.flat(), knots, nx, nu)
    for name in ("states", "controls", "duration"):
        np.testing.assert_array_equal(getattr(back, name), getattr(trajectory, name))


def test_flat_layout_is_the_documented_one_and_has_the_papers_sizes():
    trajectory = Trajectory(np.arange(6.0).reshape(1, 3, 2), np.array([[[10.0], [11.0]]]), np.array([20.0]))
    np.testing.assert_array_equal(trajectory.flat(), [[0, 1, 2, 3, 4, 5, 10, 11, 20]])
    assert (PENDULUM.flat_size, QUADCOPTER.flat_size, flat_size(25, 4, 2)) == (75, 317, 149)


def test_knots_are_uniform_and_end_at_the_duration():
    trajectory = random_trajectory(0, 3, 5, 2, 1)
    np.testing.assert_allclose(trajectory.times[:, -1], trajectory.duration)
    np.testing.assert_allclose(np.diff(trajectory.times, axis=1), trajectory.step[:, None].repeat(4, axis=1))


def test_indexing_keeps_the_batch_axis():
    trajectory = random_trajectory(0, 3, 5, 2, 1)
    assert len(trajectory[1]) == len(trajectory[-1]) == 1
    np.testing.assert_array_equal(trajectory[-1].states[0], trajectory.states[2])
    np.testing.assert_array_equal(trajectory[[2, 0]].duration, trajectory.duration[[2, 0]])
    joined = Trajectory.concatenate(list(trajectory))
    np.testing.assert_array_equal(joined.flat(), trajectory.flat())


def test_a_failed_trajectory_is_a_value():
    trajectory = random_trajectory(0, 2, 5, 2, 1)
    assert with_states(trajectory, (1, 3, 0), np.nan).finite.tolist() == [True, False]


def test_nobody_changes_a_trajectory_through_its_arrays():
    states = np.zeros((1, 3, 2))
    trajectory = Trajectory(states, np.zeros((1, 2, 1)), np.ones(1))
    with pytest.raises(ValueError, match="read-only"):
        trajectory.states[0, 0, 0] = 1.0
    states[0, 0, 0] = 1.0  # the owner of an array still may


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="expected states"):
        Trajectory(np.zeros((1, 3, 2)), np.zeros((1, 3, 1)), np.zeros(1))
    with pytest.raises(ValueError, match="75"):
        Trajectory.from_flat(np.zeros((2, 74)), 25, 2, 1)
