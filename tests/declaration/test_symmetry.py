"""Symmetries: what they must be, and plans that are averaged over them."""

import dataclasses

import numpy as np
import pytest

from moe_policy.planners.symmetric import Symmetrised
from ocp_envs import tables
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE, half_turn
from ocp_envs.symmetry import Symmetry
from ocp_envs.trajectory import Trajectory
from tests.small_problems import with_states

P = tables.starts(QUADCOPTER_OBSTACLE)[:20]
SYMMETRY = QUADCOPTER_OBSTACLE.symmetry


def mirrored(p):
    return p * [-1, -1, 1, -1, -1, 1, 1]


def random_plans(seed, count, size=1.0):
    rng, problem = np.random.default_rng(seed), QUADCOPTER_OBSTACLE
    flat = size * rng.standard_normal((count, problem.flat_size))
    return problem.unflatten(flat)


class Table:
    """Plans by parameter."""

    name = "table"

    def __init__(self, p, plans):
        self.plans = {row.tobytes(): plan for row, plan in zip(p, plans.flat())}

    def __call__(self, p):
        flat = np.array([self.plans[row.tobytes()] for row in np.atleast_2d(p)])
        return Trajectory.from_flat(flat, 20, 12, 4)


def test_an_equivariant_planner_stays_as_it_is():
    plans = random_plans(0, len(P))
    both = Trajectory.concatenate([plans, SYMMETRY.trajectories(plans)])
    planner = Symmetrised(QUADCOPTER_OBSTACLE, Table(np.concatenate([P, mirrored(P)]), both))
    np.testing.assert_allclose(planner(P).flat(), plans.flat(), atol=1e-12)
    np.testing.assert_allclose(planner(P[3]).flat(), plans.flat()[[3]], atol=1e-12)
    assert planner.name == "table, half turn"


def test_errors_of_the_two_plans_are_averaged_and_the_result_is_equivariant():
    truth, errors = random_plans(0, len(P)), random_plans(1, 2 * len(P), 0.01)
    both = Trajectory.concatenate([truth, SYMMETRY.trajectories(truth)])
    wrong = Trajectory.from_flat(both.flat() + errors.flat(), 20, 12, 4)
    planner = Symmetrised(QUADCOPTER_OBSTACLE, Table(np.concatenate([P, mirrored(P)]), wrong))
    plans = planner(P)
    back = SYMMETRY.trajectories(errors[len(P) :])
    back = Trajectory(back.states, back.controls, errors.duration[len(P) :])
    np.testing.assert_allclose(plans.flat() - truth.flat(), (errors[: len(P)].flat() + back.flat()) / 2, atol=1e-12)
    np.testing.assert_allclose(planner(mirrored(P)).flat(), SYMMETRY.trajectories(plans).flat(), atol=1e-12)


def test_plans_of_two_families_are_not_averaged():
    plans = random_plans(0, len(P))
    other = SYMMETRY.trajectories(plans)
    where = np.s_[::2, 7, 1]  # the other side, for every second instance
    other = with_states(other, where, other.states[where] + 3.0)
    planner = Symmetrised(
        QUADCOPTER_OBSTACLE, Table(np.concatenate([P, mirrored(P)]), Trajectory.concatenate([plans, other]))
    )
    taken = planner(P)
    first = P[:, 0] < mirrored(P)[:, 0]
    wanted = np.where(
        first[:, None] | (np.arange(len(P)) % 2 == 1)[:, None], plans.flat(), SYMMETRY.trajectories(other).flat()
    )
    np.testing.assert_allclose(taken.flat(), wanted, atol=1e-12)
    np.testing.assert_allclose(planner(mirrored(P)).flat(), SYMMETRY.trajectories(taken).flat(), atol=1e-12)


def test_a_problem_without_a_symmetry_is_refused():
    with pytest.raises(ValueError, match="PendulumSwingup-v0 declares no symmetry"):
        Symmetrised(PENDULUM, Table(P[:0], random_plans(0, 0)))


def test_a_symmetry_is_its_own_inverse_and_fits_its_problem():
    with pytest.raises(ValueError, match="quarter: the matrix of state is not its own inverse"):
        Symmetry("quarter", [[0, -1], [1, 0]], [1], [])
    with pytest.raises(ValueError, match="expected a square matrix or its diagonal for control"):
        Symmetry("odd", [1], np.ones((2, 3)), [])
    with pytest.raises(ValueError, match=r"expected a symmetry of 12 states, 4 controls and 4 coordinates"):
        dataclasses.replace(QUADCOPTER_OBSTACLE, symmetry=half_turn())
