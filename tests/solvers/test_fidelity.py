import dataclasses

import casadi as ca
import numpy as np
import pytest

from ocp_envs.solvers.fidelity import fidelity
from ocp_envs.system import Box, Coordinate, System
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

#: x' = u x (x of scale 2): exact solution x e^{ut}, Runge-Kutta steps are wrong from the fifth order on.
GROWTH = dataclasses.replace(
    DOUBLE_INTEGRATOR,
    id="Growth-v0",
    system=System(
        name="growth",
        state=Box((Coordinate("x", -2000.0, 2000.0, "1", scale=2.0),)),
        control=Box((Coordinate("u", -5.0, 5.0, "1/s"),)),
        constants={"rate": 1.0},
        dynamics=lambda x, u, c: [c.rate * u[0] * x[0]],
    ),
    parameters=Box((Coordinate("x", 1.0, 5.0, "1"),)),
    goal=dataclasses.replace(DOUBLE_INTEGRATOR.goal, state=[1.0], windings=[[0]]),
    hold=0.0,
    knots=3,
)


def flown(problem, x, controls, duration):
    """A trajectory along which the map of the program holds exactly."""
    states, (_, s) = [np.asarray([x])], problem.start(np.asarray([x]))
    step = np.array([[duration / (problem.knots - 1)]])
    for control in controls:
        states.append(problem.functions.flow(problem.substeps)(states[-1], np.array([control]), s, step)[0])
    return Trajectory(np.stack(states, axis=1), np.array([controls]), np.array([duration]))


def test_the_error_of_an_interval_is_that_of_the_closed_form():
    trajectory = flown(GROWTH, [1.0], [[1.0], [-1.0]], 4.0)
    found = fidelity(GROWTH, np.array([[1.0]]), trajectory)
    states = trajectory.states[0, :, 0]
    expected = np.abs(states[1:] - states[:-1] * np.exp([2.0, -2.0])) / 2.0
    np.testing.assert_allclose(found.error[0], expected, rtol=1e-6)
    (fault,) = found.faults
    assert fault.startswith("1 Runge-Kutta substeps are too few: on 1 solutions 2 of 2 intervals end off")
    assert f"the worst by {expected.max():.2g}; raise substeps or knots" in fault
    finer = dataclasses.replace(GROWTH, substeps=20)
    assert fidelity(finer, np.array([[1.0]]), flown(finer, [1.0], [[1.0], [-1.0]], 4.0)).faults == ()


def test_the_depth_between_knots_is_measured():
    """A mass passes |x| ≥ 0.1 at constant speed, with knots at ±0.1: of the points between, 0.02 is the deepest."""
    last = WALLED_INTEGRATOR.knots - 1
    states = np.stack([2.1 - 0.2 * np.arange(last + 1), np.full(last + 1, -0.2 * last)], axis=1)[None]
    trajectory = Trajectory(states, np.zeros((1, last, 1)), np.ones(1))
    found = fidelity(WALLED_INTEGRATOR, np.array([[2.1, 0.0]]), trajectory)
    assert found.largest_depth == pytest.approx(0.08)
    assert found.text.endswith("of the scales (tolerance 0.01), and clearances are entered by at most 0.08")
    assert "1 of 1 solutions enter clearance 0 by up to" in found.faults[0]
    with pytest.warns(UserWarning, match="WalledIntegrator-v0: between the points"):
        found.warn(0)


def test_what_stays_clear_passes():
    trajectory = Trajectory(np.full((2, 21, 2), 3.0) * [1, 0], np.zeros((2, 20, 1)), np.ones(2))
    found = fidelity(WALLED_INTEGRATOR, np.array([[3.0, 0.0], [3.0, 1.0]]), trajectory)
    assert (found.largest_depth, found.faults) == (0.0, ())
    np.testing.assert_array_equal(found.error < 1e-9, True)


def test_a_motion_that_cannot_be_integrated_is_left_out_of_the_errors():
    def escapes(x, u, c):
        return [x[1], ca.exp(x[0]) * c.mass]

    system = dataclasses.replace(DOUBLE_INTEGRATOR.system, dynamics=escapes)
    problem = dataclasses.replace(DOUBLE_INTEGRATOR, id="Escape-v0", system=system, hold=0.0)
    trajectory = Trajectory(np.full((1, 21, 2), 15.0), np.zeros((1, 20, 1)), np.full(1, 100.0))
    found = fidelity(problem, np.array([[1.0, 0.0]]), trajectory)
    assert np.isnan(found.error).all()
    assert np.isnan(found.largest_error)
    assert found.faults == ()


def test_there_may_be_no_solution():
    nothing = DOUBLE_INTEGRATOR.unflatten(np.empty((0, DOUBLE_INTEGRATOR.flat_size)))
    found = fidelity(DOUBLE_INTEGRATOR, np.empty((0, 2)), nothing)
    assert found.faults == ()
    assert np.isnan(found.largest_error)
    assert found.text == "no solution was measured"
