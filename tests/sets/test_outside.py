"""Parameters outside the box, against the definition of the excess and moments of the uniform shell."""

import dataclasses

import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets.discontinuity import off_centre
from ocp_envs.sets.outside import excess, open_coordinates, sample_outside, widened
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.system import Box
from tests.small_problems import DOUBLE_INTEGRATOR

#: Few solves, of large problems.
pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
BEYOND = (0.10, 0.25)


def test_coordinates_that_cover_a_whole_turn_have_no_outside():
    closed = {
        p.id: [n for n, is_open in zip(p.parameters.names, open_coordinates(p)) if not is_open]
        for p in (PENDULUM, VEHICLE, QUADCOPTER_OBSTACLE, DOUBLE_INTEGRATOR)
    }
    assert [*closed.values()] == [["theta"], ["theta"], [], []]
    half_turn = dataclasses.replace(
        PENDULUM, parameters=Box((dataclasses.replace(PENDULUM.parameters.coordinates[0], upper=np.pi),))
    )
    assert open_coordinates(half_turn).all()
    whole_turn = dataclasses.replace(PENDULUM, parameters=Box(PENDULUM.parameters.coordinates[:1]))
    with pytest.raises(ValueError, match="nothing lies outside"):
        excess(whole_turn, np.zeros((1, 1)))


def test_the_excess_is_counted_in_half_widths_of_the_worst_coordinate():
    p = np.array([[0.0, 0.0], [5.0, 1.0], [-6.0, 0.5], [6.0, -1.5], [0.0, 1.2]])  # box [-5, 5] × [-1, 1]
    np.testing.assert_allclose(excess(DOUBLE_INTEGRATOR, p), [-1.0, 0.0, 0.2, 0.5, 0.2])
    # The start at θ = 7 is that at θ = 7 − 2π: it is not outside.
    np.testing.assert_allclose(excess(PENDULUM, np.array([[7.0, 1.0], [1.0, -2.5]])), [-0.5, 0.25])


@pytest.mark.parametrize("problem", [PENDULUM, VEHICLE, QUADCOPTER], ids=lambda problem: problem.id)
def test_draws_lie_in_the_shell(problem):
    p = sample_outside(problem, 7, 3_000, BEYOND)
    e = excess(problem, p)
    assert e.min() > BEYOND[0]
    assert e.max() <= BEYOND[1]
    assert np.quantile(e, [0.02, 0.98]) == pytest.approx(BEYOND, abs=0.01)
    closed = ~open_coordinates(problem)
    assert (p[:, closed] >= problem.parameters.lower[closed]).all()
    assert (p[:, closed] <= problem.parameters.upper[closed]).all()
    # Uniform on a shell that is symmetric about the centre: five standard errors.
    centre, half = (problem.parameters.upper + problem.parameters.lower) / 2, np.ptp(p, axis=0) / 2
    np.testing.assert_allclose((p.mean(axis=0) - centre) / half, 0, atol=5 / np.sqrt(len(p)))


def test_the_share_of_draws_with_one_coordinate_outside_is_that_of_volumes():
    p, box = sample_outside(VEHICLE, 8, 4_000, BEYOND), VEHICLE.parameters
    outside = np.abs(p / box.upper)[:, [0, 1, 3]] > 1.1  # the box is symmetric about 0
    volume = 1.25**3 - 1.1**3
    alone = 3 * 0.15 * 1.1**2 / volume
    assert abs((outside.sum(axis=1) == 1).mean() - alone) < 5 * np.sqrt(alone * (1 - alone) / len(p))


def test_a_smaller_draw_begins_a_larger_one():
    np.testing.assert_array_equal(
        sample_outside(VEHICLE, 3, 2_500, BEYOND)[:40], sample_outside(VEHICLE, 3, 40, BEYOND)
    )
    assert not np.allclose(sample_outside(VEHICLE, 4, 40, BEYOND), sample_outside(VEHICLE, 3, 40, BEYOND))


@pytest.mark.parametrize("beyond", [(0.2, 0.2), (-0.1, 0.2), (0.3, 0.2)])
def test_an_empty_shell_is_refused(beyond):
    with pytest.raises(ValueError, match="0 ≤ low < high"):
        sample_outside(PENDULUM, 0, 3, beyond)


def test_a_widened_box_changes_nothing_else():
    wide = widened(QUADCOPTER_OBSTACLE, 0.25)
    assert wide.parameters.upper.tolist() == [12.5] * 6 + [5.5]
    assert wide.parameters.lower.tolist() == [-12.5] * 6 + [0.5]
    assert wide.distribution.free.parameters.upper.tolist() == [12.5] * 3
    assert wide.id == QUADCOPTER_OBSTACLE.id
    assert wide.system is QUADCOPTER_OBSTACLE.system
    np.testing.assert_array_equal(sample(widened(VEHICLE, 0), 1, 5), sample(VEHICLE, 1, 5))


def test_draws_round_an_obstacle_meet_it_from_outside_starts():
    p = sample_outside(QUADCOPTER_OBSTACLE, 5, 4, BEYOND)
    e = excess(QUADCOPTER_OBSTACLE, p)
    assert ((e > 0.10) & (e <= 0.25)).all()
    with GuardedSolver(QUADCOPTER) as solver:
        assert (off_centre(QUADCOPTER_OBSTACLE, p, solver) < 1).all()
    start, centre, radius = p[:, :3], p[:, 3:6], p[:, 6]
    assert (np.linalg.norm(centre, axis=1) > radius).all()
    assert (np.linalg.norm(centre - start, axis=1) > radius).all()
