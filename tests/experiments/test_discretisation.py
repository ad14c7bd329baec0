from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from moe_policy.experiments.discretisation import Collocation, excess, held_costs, refined
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.system import Box, Coordinate
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR, rest_to_rest

STRONG = dataclasses.replace(DOUBLE_INTEGRATOR.system, control=Box((Coordinate("u", -3.0, 3.0, "N"),)))
FREE = dataclasses.replace(DOUBLE_INTEGRATOR, system=STRONG)
WALLED = dataclasses.replace(WALLED_INTEGRATOR, system=STRONG)
#: ẍ = u from (x_0, 0) to rest at the origin: L = 1 + u²/2 makes u = −a (1 − 2 t/T), a = 6 x_0 / T² = √2, the optimum
#: where it lies within the bounds, with T⁴ = 18 x_0² and J = T + a² T / 6.
X0 = 0.4
DURATION = (18 * X0**2) ** 0.25
OPTIMUM = DURATION + (6 * X0 / DURATION**2) ** 2 * DURATION / 6


@pytest.fixture(scope="module")
def plan():
    guess = Trajectory(*rest_to_rest(np.array([X0]), 3.0, DOUBLE_INTEGRATOR.knots))
    with GuardedSolver(FREE) as solver:
        solutions = solver.solve(np.array([[X0, 0.0]]), guess, np.array([NEAREST_WINDING]))
    return solutions.trajectory, solutions.cost


def test_collocation_finds_the_optimum_in_continuous_time(plan):
    trajectory, _ = plan
    fine = refined(trajectory, 2)
    assert Collocation(FREE, 40).cost(np.array([X0, 0.0]), fine) == pytest.approx(OPTIMUM, rel=1e-6)


def test_costs_of_held_controls_decrease_towards_it(plan):
    trajectory, cost = plan
    finer = [held_costs(FREE, np.array([[X0, 0.0]]), trajectory, factor)[0] for factor in (2, 4)]
    assert OPTIMUM < finer[1] < finer[0] < cost[0]
    # Held controls are second order in the interval: differences fall to a quarter. The goal tolerance cancels.
    assert (finer[0] - finer[1]) / (cost[0] - finer[0]) == pytest.approx(1 / 4, rel=0.02)


def test_collocation_obeys_a_path_constraint(plan):
    trajectory, _ = plan
    walled = Collocation(WALLED, 40).cost(np.array([X0, -5.0]), refined(trajectory, 2))
    assert walled == pytest.approx(OPTIMUM, rel=1e-6)
    assert not np.isfinite(Collocation(WALLED, 20).cost(np.array([X0, 0.0]), trajectory))


def test_refined_plans_have_the_same_knots_and_controls(plan):
    trajectory, _ = plan
    fine = refined(trajectory, 3)
    np.testing.assert_allclose(fine.states[:, ::3], trajectory.states)
    np.testing.assert_array_equal(fine.controls[:, 1::3], trajectory.controls)
    assert fine.controls.shape[1] == 3 * trajectory.controls.shape[1] == fine.states.shape[1] - 1


def test_instances_without_an_estimate_are_left_out():
    row = excess("collocation", 40, np.array([1.01, 2.04, 3.0]), np.array([1.0, 2.0, np.inf]))
    assert row.cases == 2
    assert row.mean == pytest.approx(1.5)
    assert row.maximum == pytest.approx(2.0)
